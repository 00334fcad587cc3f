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
    np.savez(tmp_path / "k.npz", keypoints=2 * np.ones((3, 2, 133, 3)))
    for centre, u in ((0.0, 2.5), (0.5, 2.0)):
        found = door.function(job, capture, KeypointsParameters(file=tmp_path / "k.npz", pixel_centre=centre))
        assert (found.keypoints == u).all()


def write_frames(folder, ids: dict[str, list]):
    """COCO results of those frames in each camera, a person at x = 100 px in the first result, 101 px in the second …"""
    for camera, of in ids.items():
        entries = [
            coco_entry(np.full((133, 3), [100.0 + k, 50.0, 0.5]), **({} if i is None else {"image_id": i})) for k, i in enumerate(of)
        ]
        (folder / f"{camera}.json").write_text(json.dumps(entries))


@pytest.mark.parametrize(
    ("left", "right", "said"),
    [
        ([0, 0, 2], [0, 1, 2], r"left\.json: 2 results for frame 0\. Keep one per frame"),
        (["f3.jpg", "f4.jpg", "f3.jpg"], [0, 1, 2], r"left\.json: 2 results for frame 3"),
        ([0, 1, 3], [0, 1, 2], "camera right has frame 2, which left lacks"),
        ([0, 1, 2], ["1.jpg", "2.jpg", "3.jpg"], "camera right has frame 3, which left lacks"),
        ([0, 1, 2], [None] * 3, "camera left numbers its frames, right does not"),
        (["a.jpg", "b.jpg", "c.jpg"], [0, 1, 2], "image_id 'a.jpg' holds no number"),
        ([0, 1, float("nan")], [0, 1, 2], "image_id is missing in some results, or not of one kind"),
    ],
)
def test_frames_that_would_be_shifted_are_refused(tmp_path, left, right, said):
    """Of two people in frame 0 and nobody in frame 1, the second had been taken for frame 1."""
    write_frames(tmp_path, {"left": left, "right": right})
    with pytest.raises(BadInput, match=said):
        read_keypoints(tmp_path, CAMERAS)


@pytest.mark.parametrize("name", ["f{}.jpg", "view{camera}/f{}_cam{camera}.v2.png", "{}", "{}.5"])
def test_text_ids_are_ordered_by_their_numbers(tmp_path, name):
    """As words f10 comes before f5."""
    write_frames(tmp_path, {c: [name.format(n, camera=k + 7) for n in (10, 0, 5)] for k, c in enumerate(CAMERAS)})
    assert (read_keypoints(tmp_path, CAMERAS)[0][:, :, 0, 0] == np.array([[101.5], [102.5], [100.5]])).all()


def write_openpose(folder, camera: str, names: list[str]):
    (folder / camera).mkdir()
    for k, name in enumerate(names):
        person = {"pose_keypoints_2d": [100.0 + k, 50.0, 0.5] * 25}
        (folder / camera / name).write_text(json.dumps({"people": [person]}))


def test_openpose_files_are_ordered_and_compared_by_their_numbers(tmp_path):
    write_openpose(tmp_path, "left", ["f10_keypoints.json", "f0_keypoints.json", "f5_keypoints.json"])
    write_openpose(tmp_path, "right", ["r_000000000010_2d.json", "r_000000000000_2d.json", "r_000000000005_2d.json"])
    assert (read_keypoints(tmp_path, CAMERAS)[0][:, :, 0, 0] == np.array([[101.5], [102.5], [100.5]])).all()
    (tmp_path / "right/r_000000000005_2d.json").rename(tmp_path / "right/r_000000000006_2d.json")
    with pytest.raises(BadInput, match="camera right has frame 6, which left lacks"):
        read_keypoints(tmp_path, CAMERAS)
    (tmp_path / "left/f5_keypoints.json").rename(tmp_path / "left/g10_keypoints.json")
    with pytest.raises(BadInput, match=r"left: 2 files for frame 10\. Keep one"):
        read_keypoints(tmp_path, CAMERAS)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda k: k * [1 / 900, 1 / 900, 1], r"all points of left, right lie within 1 px of \(0, 0\)"),
        (lambda k: k * np.where(np.arange(2) == 1, 1 / 900, 1)[:, None, None] ** [1, 1, 0], "all points of right lie within 1 px"),
        (lambda k: k * [1, 1, 100], r"scores reach 1?\d\d"),
        (lambda k: k * [1 / 900, 1 / 900, 100], r"(?s)lie within 1 px.*scores reach"),
    ],
)
def test_shares_of_the_picture_and_per_cents_are_refused(tmp_path, keypoints, change, said):
    np.savez(tmp_path / "k.npz", keypoints=change(keypoints))
    with pytest.raises(BadInput, match=said):
        read_keypoints(tmp_path / "k.npz", CAMERAS)


def test_the_height_of_a_heat_map_is_no_per_cent(tmp_path, keypoints):
    """SimCC models and OpenPose go beyond 1."""
    np.savez(tmp_path / "k.npz", keypoints=keypoints * [1, 1, 9])
    assert read_keypoints(tmp_path / "k.npz", CAMERAS)[1].max() > 8


def test_another_number_of_frames_than_the_recordings_is_refused(tmp_path, keypoints):
    np.savez(tmp_path / "k.npz", keypoints=keypoints)
    assert len(read_keypoints(tmp_path / "k.npz", CAMERAS, frames=4)[0]) == 4
    with pytest.raises(BadInput, match=r"k\.npz: it has 4 frames, the recording 5"):
        read_keypoints(tmp_path / "k.npz", CAMERAS, frames=5)
