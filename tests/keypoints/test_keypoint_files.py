"""Keypoints from files: every layout arrives as the same 133, and what cannot be told apart is refused by name."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from tasks.geometry.faults import BadInput
from tasks.keypoints.keypoint_files import BODY_25, OPENPOSE_18, read_keypoints, wholebody133
from tasks.keypoints.stage import KeypointsParameters
from tasks.keypoints.stage import keypoints as door
from tests.storage_schemas.examples import examples

CAMERAS = ("left", "right")


@pytest.fixture
def keypoints():
    random = np.random.default_rng(0)
    return np.concatenate([random.uniform(10, 900, (4, 2, 133, 2)), random.uniform(0.2, 1, (4, 2, 133, 1))], axis=-1)


def with_neck(keypoints: np.ndarray) -> np.ndarray:
    """What DWPose's own code does before it reorders: the neck goes in at 17, as mean of the shoulders."""
    return np.insert(keypoints, 17, keypoints[..., [5, 6], :].mean(-2), axis=-2)


def openpose134(keypoints: np.ndarray) -> np.ndarray:
    """DWPose's reordering, copied as its source has it: new[openpose] = old[mmpose]."""
    old = with_neck(keypoints)
    mmpose = [17, 6, 8, 10, 7, 9, 12, 14, 16, 13, 15, 2, 1, 4, 3]
    openpose = [1, 2, 3, 4, 6, 7, 8, 9, 10, 12, 13, 14, 15, 16, 17]
    new = old.copy()
    new[..., openpose, :] = old[..., mmpose, :]
    return new


@pytest.mark.parametrize("layout", [lambda k: k, with_neck, openpose134], ids=["133", "neck at 17", "openpose order"])
def test_npz_layouts_agree(tmp_path, keypoints, layout):
    np.savez(tmp_path / "k.npz", keypoints=layout(keypoints))
    uv, score = read_keypoints(tmp_path / "k.npz", CAMERAS)
    np.testing.assert_allclose(uv, keypoints[..., :2] + 0.5)  # from OpenCV's pixel centres to this project's
    np.testing.assert_allclose(score, keypoints[..., 2])
    assert read_keypoints(tmp_path / "k.npz", CAMERAS, pixel_centre=0.5)[0][0, 0, 0, 0] == pytest.approx(keypoints[0, 0, 0, 0])


def test_absent_points_are_nan_with_score_zero(tmp_path, keypoints):
    keypoints[1, 0, 3] = 0
    keypoints[2, 1, 5, 0] = np.nan
    np.savez(tmp_path / "k.npz", keypoints=keypoints)
    uv, score = read_keypoints(tmp_path / "k.npz", CAMERAS)
    assert np.isnan(uv[1, 0, 3]).all() and score[1, 0, 3] == 0 and np.isnan(uv[2, 1, 5]).all() and score[2, 1, 5] == 0
    assert np.isnan(uv).any(-1).sum() == 2


def test_unclear_134_is_refused(keypoints):
    nowhere = np.insert(keypoints, 17, keypoints[..., 5, :] + 40, axis=-2)
    with pytest.raises(BadInput, match=r"k\.npz: 134 keypoints, but neither 1 nor 17"):
        wholebody133(nowhere, "k.npz")
    both = openpose134(keypoints)
    both[..., 17, :] = both[..., [5, 6], :].mean(-2)
    with pytest.raises(BadInput, match="both 1 and 17 could be the neck"):
        wholebody133(both, "k.npz")


@pytest.mark.parametrize(("count", "name"), [(17, "COCO body only"), (136, "Halpe 136"), (100, "100 keypoints")])
def test_other_counts_are_refused(count, name):
    with pytest.raises(BadInput, match=name):
        wholebody133(np.zeros((2, count, 3)), "k.npz")


def write_coco(folder, keypoints):
    parts = {"keypoints": (0, 17), "foot_kpts": (17, 23), "face_kpts": (23, 91), "lefthand_kpts": (91, 112), "righthand_kpts": (112, 133)}
    for c, camera in enumerate(CAMERAS):
        entries = [
            {"image_id": t, **{name: keypoints[t, c, a:b].ravel().tolist() for name, (a, b) in parts.items()}}
            for t in range(len(keypoints))
        ]
        (folder / f"{camera}.json").write_text(json.dumps(entries[::-1]))  # order in the file does not matter


def test_coco_wholebody_results(tmp_path, keypoints):
    write_coco(tmp_path, keypoints)
    uv, score = read_keypoints(tmp_path, CAMERAS)
    np.testing.assert_allclose(uv, keypoints[..., :2] + 0.5)
    np.testing.assert_allclose(score, keypoints[..., 2])


@pytest.mark.parametrize(("order", "count", "found"), [(BODY_25, 25, 23), (OPENPOSE_18, 18, 17)])
def test_openpose_frames(tmp_path, keypoints, order, count, found):
    bystander = {"pose_keypoints_2d": [0.01] * 3 * count}
    for c, camera in enumerate(CAMERAS):
        (tmp_path / camera).mkdir()
        for t, k in enumerate(keypoints[:, c]):
            body = np.zeros((count, 3))
            body[list(order)] = k[:found]
            person = {
                "pose_keypoints_2d": body.ravel().tolist(),
                "face_keypoints_2d": np.concatenate([k[23:91], np.ones((2, 3))]).ravel().tolist(),
                "hand_left_keypoints_2d": k[91:112].ravel().tolist(),
                "hand_right_keypoints_2d": k[112:133].ravel().tolist(),
            }
            (tmp_path / camera / f"{t:03d}_keypoints.json").write_text(json.dumps({"people": [bystander, person]}))
    uv, score = read_keypoints(tmp_path, CAMERAS)
    expected = keypoints[..., :2] + 0.5
    np.testing.assert_allclose(uv[:, :, :found], expected[:, :, :found])
    np.testing.assert_allclose(uv[:, :, 23:], expected[:, :, 23:])
    assert np.isnan(uv[:, :, found:23]).all() and (score[:, :, found:23] == 0).all()


def test_openpose_order_matches_its_names():
    """BODY_25 by name (OpenPose's documentation) against COCO's order by name."""
    body_25 = ["nose", "neck", *(f"right_{part}" for part in ("shoulder", "elbow", "wrist"))]
    body_25 += [*(f"left_{part}" for part in ("shoulder", "elbow", "wrist")), "mid_hip"]
    body_25 += [f"{side}_{part}" for side in ("right", "left") for part in ("hip", "knee", "ankle")]
    body_25 += ["right_eye", "left_eye", "right_ear", "left_ear"]
    body_25 += [f"{side}_{part}" for side in ("left", "right") for part in ("big_toe", "small_toe", "heel")]
    from tasks.body.wholebody import NAMES

    assert [body_25[k] for k in BODY_25] == list(NAMES[:23])


def test_all_faults_of_a_folder_are_named(tmp_path):
    (tmp_path / "left.json").write_text("[{")
    with pytest.raises(BadInput) as caught:
        read_keypoints(tmp_path, CAMERAS)
    assert len(caught.value.faults) == 2
    assert "left.json" in str(caught.value) and "camera right" in str(caught.value)


def test_cameras_of_different_length_are_refused(tmp_path, keypoints):
    write_coco(tmp_path, keypoints)
    entries = json.loads((tmp_path / "left.json").read_text())
    (tmp_path / "left.json").write_text(json.dumps(entries[:-1]))
    with pytest.raises(BadInput, match="different numbers of frames"):
        read_keypoints(tmp_path, CAMERAS)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut", b"no zip at all"])
def test_broken_npz_is_refused(tmp_path, content):
    (tmp_path / "k.npz").write_bytes(content)
    with pytest.raises(BadInput, match="not a readable"):
        read_keypoints(tmp_path / "k.npz", CAMERAS)


def coco_entry(keypoints: np.ndarray, **other) -> dict:
    return {"keypoints": keypoints.ravel().tolist()} | other


def read_left(folder, entries):
    (folder / "left.json").write_text(json.dumps(entries))
    return read_keypoints(folder, ("left",))


@pytest.mark.parametrize("layout", [with_neck, openpose134], ids=["neck at 17", "openpose order"])
def test_the_layout_of_134_is_told_from_all_frames_and_cameras_together(tmp_path, keypoints, layout):
    keypoints[0, 0, 5], keypoints[:, 1, 6] = 0, 0  # a shoulder hidden in one frame, another in all frames of a camera
    wide = layout(keypoints)
    for c, camera in enumerate(CAMERAS):
        (tmp_path / f"{camera}.json").write_text(json.dumps([coco_entry(k, image_id=t) for t, k in enumerate(wide[:, c])]))
    score = read_keypoints(tmp_path, CAMERAS)[1]
    np.testing.assert_allclose(score, keypoints[..., 2])
    wide[..., 2] = 0
    with pytest.raises(BadInput, match="no frame shows the neck and both shoulders"):
        wholebody133(wide, "k.npz")


@pytest.mark.parametrize(
    ("broken", "said"),
    [
        ({"keypoints": [1.0, 2.0] * 133}, r"frame 7: keypoints: numbers of shape \(266,\)"),
        ({"keypoints": [[1.0, 2.0]] * 133}, r"frame 7: keypoints: numbers of shape \(133, 2\)"),
        ({"keypoints": [[1.0, 2.0], [1.0]]}, "frame 7: keypoints: not a list of numbers"),
        ({"keypoints": [1.0] * 51, "foot_kpts": None}, "frame 7: foot_kpts has 0 points"),
        ({"keypoints": [1.0] * 51, "foot_kpts": {"x": 1}}, "frame 7: foot_kpts: not a list of numbers"),
        ({"keypoints": [1.0] * 402}, "some frames have 133 keypoints, some 134"),
        ({"image_id": "7"}, "image_id is missing in some results, or not of one kind"),
        ({"image_id": None}, "image_id is missing in some results, or not of one kind"),
    ],
)
def test_what_is_no_coco_result_is_refused_with_file_and_frame(tmp_path, broken, said):
    sound = coco_entry(np.ones((133, 3)), image_id=6)
    with pytest.raises(BadInput, match=r"left\.json: " + said):
        read_left(tmp_path, [sound, sound | {"image_id": 7} | broken])


def test_results_without_image_id_keep_the_order_of_the_file(tmp_path, keypoints):
    uv, _ = read_left(tmp_path, [coco_entry(k) for k in keypoints[::-1, 0]])
    np.testing.assert_allclose(uv[:, 0], keypoints[::-1, 0, :, :2] + 0.5)


@pytest.mark.parametrize("people", [[[1.0, 2.0]], [None], {"pose_keypoints_2d": []}, [{"pose_keypoints_2d": [1.0, 2.0]}]])
def test_what_is_no_openpose_frame_is_refused_by_name(tmp_path, people):
    (tmp_path / "left").mkdir()
    (tmp_path / "left/000.json").write_text(json.dumps({"people": people}))
    with pytest.raises(BadInput, match=r"000\.json"):
        read_keypoints(tmp_path, ("left",))


def test_of_several_people_the_one_whose_scores_sum_highest_is_taken(tmp_path):
    half, whole = np.zeros((18, 3)), np.full((18, 3), [5.0, 5.0, 0.6])
    half[:4] = [3.0, 3.0, 0.9]  # surer, point by point
    (tmp_path / "left").mkdir()
    people = [{"pose_keypoints_2d": body.ravel().tolist()} for body in (half, whole)]
    (tmp_path / "left/000.json").write_text(json.dumps({"people": people}))
    assert read_keypoints(tmp_path, ("left",))[0][0, 0, 0, 0] == 5.5


def test_the_door_passes_the_pixel_centre_on(tmp_path):
    job, capture = SimpleNamespace(recording=tmp_path), examples()["capture"].model_copy(update={"template": None})
    np.savez(tmp_path / "k.npz", keypoints=np.ones((3, 2, 133, 3)))
    for centre, u in ((0.0, 1.5), (0.5, 1.0)):
        found = door.function(job, capture, KeypointsParameters(file=tmp_path / "k.npz", pixel_centre=centre))
        assert (found.keypoints == u).all()
