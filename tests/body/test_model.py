import numpy as np
import pytest
import smplx
import torch

from tasks.body.model import BodyModel
from tasks.geometry.faults import BadInput


def random_pose(frames: int = 3) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(0)
    return (
        np.tile(rng.normal(size=10), (frames, 1)),
        rng.normal(size=(frames, 10)),
        rng.normal(0, 0.4, (frames, 55, 3)),
        rng.normal(size=(frames, 3)),
    )


@pytest.fixture(scope="module")
def stiffened(body_path, tmp_path_factory):
    """The demo body with random pose correctives and uneven hands, so that no term of the formula is zero."""
    rng = np.random.default_rng(1)
    arrays = dict(np.load(body_path))
    arrays["posedirs"] = rng.normal(0, 1e-3, arrays["posedirs"].shape).astype(np.float32)
    path = tmp_path_factory.mktemp("model") / "SMPLX_NEUTRAL.npz"
    np.savez(path, **arrays)
    return path


def smplx_output(path, shape, expression, pose, translation):
    reference = smplx.SMPLX(str(path), use_pca=False, flat_hand_mean=True, batch_size=len(pose), dtype=torch.float64)
    flat = torch.as_tensor(pose).reshape(len(pose), -1)
    return reference(
        betas=torch.as_tensor(shape), expression=torch.as_tensor(expression), transl=torch.as_tensor(translation),
        global_orient=flat[:, :3], body_pose=flat[:, 3:66], jaw_pose=flat[:, 66:69], leye_pose=flat[:, 69:72], reye_pose=flat[:, 72:75],
        left_hand_pose=flat[:, 75:120], right_hand_pose=flat[:, 120:],
    )  # fmt: skip


def test_pose_is_that_of_smplx(stiffened):
    shape, expression, pose, translation = random_pose()
    posed = BodyModel.load(stiffened).pose(shape, expression, pose, translation)
    reference = smplx_output(stiffened, shape, expression, pose, translation)
    # smplx adds 1e-8 to every angle before taking its norm
    assert np.abs(posed.vertices - reference.vertices.detach().numpy()).max() < 1e-7
    assert np.abs(posed.joints - reference.joints.detach().numpy()[:, :55]).max() < 1e-7


def test_transforms_carry_rest_vertices(model):
    shape, expression, pose, translation = random_pose()
    posed = model.pose(shape, expression, pose, translation)
    rest = model.pose(shape, expression, np.zeros((3, 55, 3)), np.zeros((3, 3))).vertices
    blended = np.einsum("vj,fjab->fvab", model.weights, posed.transforms)
    by_hand = np.einsum("fvab,fvb->fva", blended[..., :3, :3], rest) + blended[..., :3, 3]
    assert np.abs(by_hand - posed.vertices).max() < 1e-12


def test_shape_of_one_serves_many_frames(model):
    shape, expression, pose, translation = random_pose()
    together = model.pose(shape[0], expression, pose, translation).vertices
    alone = np.array([model.pose(shape[0], *frame).vertices for frame in zip(expression, pose, translation, strict=True)])
    assert np.abs(together - alone).max() < 1e-12


def test_a_file_that_is_not_smplx_is_refused_with_all_its_faults(body_path, tmp_path):
    arrays = dict(np.load(body_path))
    del arrays["lmk_faces_idx"], arrays["hands_meanl"]
    arrays["weights"] = arrays["weights"][:, :24]
    np.savez(tmp_path / "SMPL_NEUTRAL.npz", **arrays)
    with pytest.raises(BadInput) as caught:
        BodyModel.load(tmp_path / "SMPL_NEUTRAL.npz")
    message = str(caught.value)
    assert "hands_meanl, lmk_faces_idx missing" in message
    assert "weights" in message and "24" in message
    assert "SMPLX_NEUTRAL.npz" in message


@pytest.mark.parametrize("content", [None, b"", b"not a zip", b"PK\x03\x04 cut"])
def test_an_unreadable_file_is_refused(tmp_path, content):
    path = tmp_path / "model.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(BadInput, match=r"model\.npz"):
        BodyModel.load(path)


def test_a_cut_archive_is_refused(body_path, tmp_path):
    path = tmp_path / "model.npz"
    whole = body_path.read_bytes()
    path.write_bytes(whole[:4000] + b"\0" * 4000 + whole[8000:])  # the table of contents at the end survives
    with pytest.raises(BadInput, match=r"model\.npz"):
        BodyModel.load(path)
