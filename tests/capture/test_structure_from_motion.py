"""A rig from one picture per camera: rendered room corner with truth; failures that say so."""

import numpy as np
import pytest

from tasks.capture.structure_from_motion import calibrate_from_pictures
from tasks.geometry.cameras import Cameras
from tasks.geometry.faults import BadInput
from tasks.geometry.rotations import axis_angle_from_matrix
from tests.capture.planes import Rectangle, rays, render, texture
from tests.capture.recordings import ring

ROOM = [
    Rectangle(np.array([-2.0, 0, -2]), np.array([4.0, 0, 0]), np.array([0, 0, 4.0]), texture(0, 1024)),
    Rectangle(np.array([-2.0, 3, -2]), np.array([4.0, 0, 0]), np.array([0, -3.0, 0]), texture(1, 1024)),
    Rectangle(np.array([-2.0, 3, 2]), np.array([0, 0, -4.0]), np.array([0, -3.0, 0]), texture(2, 1024)),
    Rectangle(np.array([-0.8, 0.9, -0.4]), np.array([0.8, 0, -0.3]), np.array([0, -0.9, 0]), texture(3, 512)),
    Rectangle(np.array([-0.4, 0.6, 0.5]), np.array([0.6, 0, -0.5]), np.array([0, -0.6, 0]), texture(4, 512)),
]


def arc(count: int = 6) -> Cameras:
    """Cameras 12° apart, all looking into the corner of the room."""
    whole = ring(30, size=(640, 480), focal=600, height=0.9, radius=3.0)
    return whole.subset(range(1, count + 1))


@pytest.fixture(scope="module")
def pictures() -> dict[str, np.ndarray]:
    rig = arc()
    return {n: render(rig, k, ROOM, rays(rig, k, samples=2)) for k, n in enumerate(rig.names)}


def aligned(found: Cameras, truth: Cameras) -> tuple[np.ndarray, np.ndarray]:
    """Rotation errors in degrees and centre errors in metres after the best similarity (Umeyama 1991)."""
    a, b = found.centres(), truth.centres()
    A, B = a - a.mean(0), b - b.mean(0)
    U, S, Vt = np.linalg.svd(B.T @ A)
    D = np.diag([1, 1, np.linalg.det(U @ Vt)])
    Q, s = U @ D @ Vt, np.trace(np.diag(S) @ D) / (A**2).sum()
    turn = np.linalg.norm(axis_angle_from_matrix(found.R @ Q.T @ truth.R.transpose(0, 2, 1)), axis=1)
    return np.degrees(turn), np.linalg.norm(s * A @ Q.T - B, axis=1)


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize("known_lenses", [True, False])
def test_a_room_gives_the_rig(pictures, known_lenses):
    rig = arc()
    apart = float(np.linalg.norm(rig.centres()[0] - rig.centres()[5]))
    found = calibrate_from_pictures(pictures, baseline=(rig.names[0], rig.names[5], apart), lenses=rig if known_lenses else None)
    degrees, metres = aligned(found.cameras, rig)
    print(found.residual_px, found.observations, degrees, metres)
    C = found.cameras.centres()
    assert np.linalg.norm(C[0] - C[5]) == pytest.approx(apart)
    assert found.residual_px.max() < 1
    assert found.observations.min() > 50
    assert degrees.max() < (0.2 if known_lenses else 1.0)
    assert metres.max() < (0.01 if known_lenses else 0.05)
    np.testing.assert_allclose(found.cameras.K[:, 0, 0], 600, rtol=1e-9 if known_lenses else 0.05)


@pytest.mark.slow
def test_pictures_without_texture_name_the_cameras():
    blank = {n: np.full((240, 320, 3), 100, np.uint8) for n in ("a", "b", "c")}
    with pytest.raises(BadInput, match="a: could not be placed"):
        calibrate_from_pictures(blank, baseline=("a", "b", 1.0))


def test_too_few_pictures_and_too_little_time():
    blank = {n: np.full((24, 32, 3), 100, np.uint8) for n in ("a", "b", "c")}
    with pytest.raises(BadInput, match="there are 2"):
        calibrate_from_pictures({n: blank[n] for n in "ab"}, baseline=("a", "b", 1.0))
    with pytest.raises(BadInput, match="no camera 'd'"):  # before COLMAP is begun
        calibrate_from_pictures(blank, baseline=("a", "d", 1.0), timeout_s=0.01)
    with pytest.raises(BadInput, match=r"longer than 0\.01 s"):
        calibrate_from_pictures(blank, baseline=("a", "b", 1.0), timeout_s=0.01)
