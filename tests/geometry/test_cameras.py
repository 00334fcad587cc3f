"""Cameras against OpenCV's projection, and triangulation against known points."""

import cv2
import numpy as np
import pytest

from tasks.geometry.cameras import Cameras, project, triangulate, undistort_points
from tasks.geometry.rotations import axis_angle_from_matrix, matrix_from_axis_angle, rotation_between


def ring(count: int = 4, *, distorted: bool) -> Cameras:
    """`count` cameras on a ring of 3 m that look at the origin, alternately landscape and portrait."""
    angle = np.arange(count) * 2 * np.pi / count
    C = np.stack([3 * np.sin(angle), 0.3 * np.cos(3 * angle), 3 * np.cos(angle)], 1)
    forward = -C / np.linalg.norm(C, axis=1, keepdims=True)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    R = np.stack([right, np.cross(forward, right), forward], 1)
    size = np.array([[640, 480] if k % 2 == 0 else [480, 640] for k in range(count)], np.int32)
    K = np.zeros((count, 3, 3))
    K[:, 0, 0], K[:, 1, 1], K[:, 2, 2] = 700.0, 710.0, 1.0
    K[:, :2, 2] = size / 2 + [3.0, -5.0]
    d = np.array([-0.1, 0.02, 1e-3, -2e-3, 5e-3]) * distorted
    return Cameras(tuple(f"Cam{k + 1:03d}" for k in range(count)), K, R, -np.einsum("kij,kj->ki", R, C), size, np.tile(d, (count, 1)))


@pytest.fixture
def points() -> np.ndarray:
    return np.random.default_rng(1).uniform(-0.5, 0.5, (30, 3))


def test_projection_is_opencvs(points):
    cameras = ring(distorted=True)
    uv, depth = project(cameras, points)
    for k in range(len(cameras)):
        theirs, _ = cv2.projectPoints(points, axis_angle_from_matrix(cameras.R[k]), cameras.t[k], cameras.K[k], cameras.distortion[k])
        np.testing.assert_allclose(uv[k], theirs[:, 0], atol=1e-6)
    np.testing.assert_allclose(depth[0], points @ cameras.R[0, 2] + cameras.t[0, 2])


def test_points_behind_a_camera_have_no_pixel():
    cameras = ring(distorted=False)
    uv, depth = project(cameras, np.array([[0.0, 0.0, 10.0]]))
    assert depth[0, 0] < 0
    assert np.isnan(uv[0, 0]).all()


def test_undistort_inverts_the_distortion(points):
    distorted, straight = ring(distorted=True), ring(distorted=False)
    np.testing.assert_allclose(undistort_points(distorted, project(distorted, points)[0]), project(straight, points)[0], atol=1e-9)


def test_triangulation_finds_the_points_and_knows_when_it_cannot(points):
    cameras = ring(distorted=True)
    uv = project(cameras, points)[0]
    weight = np.ones(uv.shape[:2])
    weight[1:, 0] = 0  # the first point is seen by one camera only
    x, residual = triangulate(cameras, uv, weight)
    assert np.isnan(x[0]).all()
    np.testing.assert_allclose(x[1:], points[1:], atol=1e-9)
    assert np.nanmax(residual[:, 1:]) < 1e-6
    _, bad = triangulate(cameras, uv + np.array([40.0, 0.0]), weight)  # negative control: pixels that fit no point
    assert np.nanmedian(bad[:, 1:]) > 5


def test_scaled_rig_sees_the_same_directions(points):
    cameras = ring(distorted=False)
    half = cameras.scaled(0.5)
    np.testing.assert_allclose(project(half, points)[0] * (cameras.size / half.size)[:, None], project(cameras, points)[0], atol=1e-9)


def test_rotations():
    r = np.random.default_rng(0).normal(size=(50, 3))
    R = matrix_from_axis_angle(r)
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (50, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(matrix_from_axis_angle(axis_angle_from_matrix(R)), R, atol=1e-9)
    np.testing.assert_allclose(matrix_from_axis_angle(np.array([0, 0, np.pi / 2])) @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    a, b = r[:25], r[25:]
    np.testing.assert_allclose(np.cross((rotation_between(a, b) @ a[..., None])[..., 0], b), 0, atol=1e-9)
    np.testing.assert_allclose(rotation_between(np.array([1.0, 0, 0]), np.array([-1.0, 0, 0])) @ [1, 0, 0], [-1, 0, 0], atol=1e-12)
