"""Skinning against what rigid bodies must do, and un-posing against skinning."""

import numpy as np

from tasks.geometry.rotations import matrix_from_axis_angle
from tasks.skinning.linear_blend import SQUEEZE, repose, unpose


def random_transforms(rng, joints: int, *, angle: float):
    T = np.tile(np.eye(4), (joints, 1, 1))
    axis = rng.normal(size=(joints, 3))
    T[:, :3, :3] = matrix_from_axis_angle(angle * axis / np.linalg.norm(axis, axis=1, keepdims=True))
    T[:, :3, 3] = rng.normal(size=(joints, 3))
    return T


def random_skin(rng, vertices: int, joints: int):
    w = rng.dirichlet(np.full(joints, 0.3), size=vertices)
    return rng.normal(size=(vertices, 3)), w


def test_identity_transforms_move_nothing():
    x, w = random_skin(np.random.default_rng(0), 30, 5)
    np.testing.assert_allclose(repose(x, w, np.tile(np.eye(4), (2, 5, 1, 1))), np.stack([x, x]), atol=1e-14)


def test_equal_transforms_move_rigidly_whatever_the_weights():
    rng = np.random.default_rng(1)
    x, w = random_skin(rng, 30, 5)
    T = random_transforms(rng, 1, angle=2.0)[0]
    np.testing.assert_allclose(repose(x, w, np.tile(T, (5, 1, 1))), x @ T[:3, :3].T + T[:3, 3], atol=1e-13)


def test_two_joints_by_hand():
    """Half a shift by (2, 0, 0) and half a quarter turn about z take (1, 0, 0) to the middle of (3, 0, 0) and (0, 1, 0)."""
    T = np.tile(np.eye(4), (2, 1, 1))
    T[0, 0, 3] = 2
    T[1, :2, :2] = [[0, -1], [1, 0]]
    np.testing.assert_allclose(repose(np.array([[1.0, 0, 0]]), np.array([[0.5, 0.5]]), T), [[1.5, 0.5, 0]], atol=1e-15)


def test_unposing_undoes_posing():
    rng = np.random.default_rng(2)
    x, w = random_skin(rng, 200, 6)
    T = random_transforms(rng, 6, angle=1.0)
    back = unpose(repose(x, w, T), w, T)
    assert not back.squeezed.any()
    np.testing.assert_allclose(back.x_rest, x, atol=1e-11)


def test_a_blend_that_flattens_space_is_flagged_and_stays_finite():
    """Equal parts of no turn and a half turn about z keep only the z axis."""
    T = np.tile(np.eye(4), (2, 1, 1))
    T[1, :3, :3] = np.diag([-1.0, -1, 1])
    w = np.array([[0.55, 0.45], [0.9, 0.1]])
    back = unpose(np.array([[0.3, 0, 1], [0.8, 0, 1]]), w, T)
    assert back.squeezed.tolist() == [True, False]  # 0.9 − 0.1 = 0.8 > SQUEEZE
    np.testing.assert_allclose(back.x_rest, [[0.3, 0, 1], [1, 0, 1]], atol=1e-12)


def test_the_guard_sits_where_its_docstring_says():
    """σ_min of an equal blend of rotations θ apart is cos(θ/2)."""
    for degrees, flagged in ((156, False), (158, True)):
        T = np.tile(np.eye(4), (2, 1, 1))
        T[1, :3, :3] = matrix_from_axis_angle(np.array([0, 0, np.deg2rad(degrees)]))
        assert unpose(np.ones((1, 3)), np.array([[0.5, 0.5]]), T).squeezed[0] == flagged
    assert np.isclose(2 * np.rad2deg(np.arccos(SQUEEZE)), 156.9, atol=0.1)
