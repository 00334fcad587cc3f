"""A rig from a carried board: against rigs whose truth is known, with noise, with a chain of shared views, and from rendered pictures."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.capture.charuco import Board, board_faults, calibrate_charuco
from tasks.capture.rig_calibration import levelled, moved, scaled_to
from tasks.geometry.cameras import Cameras, project
from tasks.geometry.faults import BadInput
from tasks.geometry.rotations import axis_angle_from_matrix, matrix_from_axis_angle
from tests.capture.planes import Rectangle, rays, render
from tests.capture.recordings import ring

BOARD = Board(6, 5, 0.15, 0.115, "DICT_4X4_50")


def studio(count: int = 6, *, size=(640, 480), focal: float = 700.0) -> Cameras:
    """A ring with lenses that differ and bend; x, y, z as in the world of a board on the floor."""
    rig = ring(count, size=size, focal=focal, height=0.8, above=1.3)
    rng = np.random.default_rng(3)
    K = rig.K.copy()
    K[:, [0, 1], [0, 1]] *= rng.uniform(0.95, 1.05, (count, 2))
    K[:, :2, 2] += rng.normal(size=(count, 2)) * 5
    distortion = np.array([-0.08, 0.05, 1e-3, -1e-3, 0]) * rng.uniform(0.5, 1.5, (count, 1))
    return replace(rig, K=K, distortion=distortion)


def carried(frames: int, seed: int = 0, *, facing: np.ndarray | None = None) -> list[tuple[np.ndarray, np.ndarray]]:
    """Poses of the board, front outwards in turn all round, tilted at random; frame 0 lies on the floor, face up."""
    rng = np.random.default_rng(seed)
    middle = np.array([0.45, 0.375, 0])
    poses = [(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]).T, np.zeros(3))]  # x along x, y along z, and z, which points into it, down
    for φ in np.linspace(0, 2 * np.pi, frames - 1, endpoint=False) if facing is None else facing:
        out = np.array([[np.cos(φ), 0, -np.sin(φ)], [0, 1, 0], [np.sin(φ), 0, np.cos(φ)]]).T  # turns z to (sin φ, 0, cos φ)
        R = out @ np.diag([1.0, -1, -1]) @ matrix_from_axis_angle(rng.normal(size=3) * 0.35)  # the board's z points away from who sees it
        poses.append((R, np.array([0, 1.0, 0]) + rng.normal(size=3) * 0.15 - R @ middle))
    return poses


def corners_seen(rig: Cameras, poses: list, noise: float, seed: int = 0) -> np.ndarray:
    """Corners [camera, frame, corner, 2] in front of the board, inside the picture, at less than 65° from its normal."""
    x = np.stack([BOARD.corners() @ R.T + t for R, t in poses])
    uv, depth = project(rig, x)
    to_camera = rig.centres()[:, None, None] - x
    towards = np.einsum("kfci,fi->kfc", to_camera, np.stack([-R[:, 2] for R, _ in poses])) / np.linalg.norm(to_camera, axis=-1)
    inside = (depth > 0) & (uv > 0).all(-1) & (uv < rig.size[:, None, None]).all(-1) & (towards > 0.42)
    return np.where(inside[..., None], uv + np.random.default_rng(seed).normal(size=uv.shape) * noise, np.nan)


def pose_errors(found: Cameras, truth: Cameras) -> tuple[np.ndarray, np.ndarray]:
    """Degrees between rotations and millimetres between centres."""
    turn = np.linalg.norm(axis_angle_from_matrix(found.R @ truth.R.transpose(0, 2, 1)), axis=1)
    return np.degrees(turn), 1000 * np.linalg.norm(found.centres() - truth.centres(), axis=1)


def volume_error(found: Cameras, truth: Cameras) -> np.ndarray:
    """rms distance [camera] px between where both rigs see points of the volume in which the board was carried."""
    x = np.random.default_rng(1).uniform([-0.4, 0.6, -0.4], [0.4, 1.4, 0.4], (200, 3))
    return np.sqrt(np.mean(np.sum((project(found, x)[0] - project(truth, x)[0]) ** 2, -1), 1))


def calibrate(rig: Cameras, uv: np.ndarray, **kwargs):
    return calibrate_charuco(uv, BOARD, names=rig.names, size=rig.size, **kwargs)


def test_without_noise_the_rig_is_exact():
    rig = studio()
    found = calibrate(rig, corners_seen(rig, carried(25), 0.0), floor_frame=0)
    degrees, mm = pose_errors(found.cameras, rig)
    assert degrees.max() < 1e-3
    assert mm.max() < 0.05
    np.testing.assert_allclose(found.cameras.K, rig.K, atol=0.05)
    assert found.residual_px.max() < 1e-3


def test_with_noise_errors_are_those_that_noise_explains():
    """0.2 px on each coordinate leaves 0.28 px rms; what is left after 14 + 6 parameters per camera and board is a little less."""
    rig = studio()
    found = calibrate(rig, corners_seen(rig, carried(25), 0.2), floor_frame=0)
    assert found.residual_px == pytest.approx(np.full(6, 0.28), rel=0.15)
    degrees, mm = pose_errors(found.cameras, rig)
    assert volume_error(found.cameras, rig).max() < 0.6
    assert degrees.max() < 2  # principal point and rotation trade places: 1 px is 0.08°
    assert mm.max() < 30  # at 2.6 m


def test_errors_shrink_with_the_noise():
    rig = studio()
    errors = [volume_error(calibrate(rig, corners_seen(rig, carried(25), s), floor_frame=0).cameras, rig).mean() for s in (0.2, 0.02)]
    assert errors[0] / errors[1] == pytest.approx(10, rel=0.25)


def test_a_wrong_corner_does_not_pull_the_rig_away():
    rig = studio()
    uv = corners_seen(rig, carried(25), 0.1)
    seen = np.argwhere(np.isfinite(uv).all(-1))
    for k, f, c in seen[:: len(seen) // 12]:
        uv[k, f, c] += 25
    assert volume_error(calibrate(rig, uv, floor_frame=0).cameras, rig).max() < 0.6


def test_no_board_on_the_floor_leaves_shape_and_scale():
    rig = studio()
    found = calibrate(rig, corners_seen(rig, carried(25), 0.0)).cameras
    C, D = (np.linalg.norm(c.centres()[:, None] - c.centres()[None], axis=-1) for c in (found, rig))
    np.testing.assert_allclose(C, D, atol=1e-4)
    assert -found.R[:, 1].mean(axis=0)[[0, 2]] == pytest.approx([0, 0], abs=1e-9)
    np.testing.assert_allclose(found.R[:, 1, 1], rig.R[:, 1, 1], atol=1e-4)  # a ring's tilts cancel


def test_cameras_without_a_chain_of_boards_are_named():
    rig = studio()
    uv = corners_seen(rig, carried(25), 0.0)
    uv[3, :-2] = np.nan
    with pytest.raises(BadInput, match="Cam004: the board was found in"):
        calibrate(rig, uv)
    uv = corners_seen(rig, carried(25), 0.0)
    uv[:3, ::2] = uv[3:, 1::2] = np.nan
    with pytest.raises(BadInput) as caught:
        calibrate(rig, uv)
    assert [f.where for f in caught.value.faults] == ["Cam004", "Cam005", "Cam006"]
    with pytest.raises(BadInput, match="floor_frame"):
        calibrate(rig, corners_seen(rig, carried(25), 0.0), floor_frame=99)


@pytest.mark.parametrize(
    ("board", "says"),
    [
        (BOARD, []),
        (Board(5, 3, 0.06, 0.045), []),
        (Board(9, 6, 0.06, 0.07), ["markers of 0.07 m on squares of 0.06 m"]),
        (Board(9, 6, 60, 45), ["markers of 45 m on squares of 60 m"]),
        (Board(9, 6, 0.06, float("nan")), ["markers of nan m"]),
        (Board(1, 1, 0.06, 0.0), ["1 x 1 squares", "markers of 0 m"]),
        (Board(-9, -6, 0.06, 0.045), ["-9 x -6 squares"]),
        (Board(25, 21, 0.06, 0.045), ["25 x 21 squares. Every other one shows a marker, and DICT_5X5_250 has 250"]),
    ],
)
def test_boards_that_cannot_be_printed_or_used(board, says):
    found = board_faults(board)
    assert len(found) == len(says)
    assert all(word in str(fault) for word, fault in zip(says, found))


def test_a_moved_rig_sees_moved_points():
    rig, rng = studio(), np.random.default_rng(0)
    R, t, x = matrix_from_axis_angle(rng.normal(size=3)), rng.normal(size=3), rng.normal(size=(5, 3)) * 0.3
    np.testing.assert_allclose(project(moved(rig, R, t, scale=2.5), 2.5 * (x @ R.T + t))[0], project(rig, x)[0], atol=1e-6)
    level = levelled(moved(rig, R, t))
    np.testing.assert_allclose(levelled(rig).R[:, 1, 1], level.R[:, 1, 1], atol=1e-9)
    C = scaled_to(rig, ("Cam001", "Cam003", 1.0)).centres()
    assert np.linalg.norm(C[0] - C[2]) == pytest.approx(1)
    with pytest.raises(BadInput, match="no camera 'Cam099'"):
        scaled_to(rig, ("Cam001", "Cam099", 1.0))


def rectangle(R: np.ndarray, t: np.ndarray) -> Rectangle:
    size = np.array([BOARD.columns, BOARD.rows]) * BOARD.square_m
    return Rectangle(t, R[:, 0] * size[0], R[:, 1] * size[1], BOARD.picture(100).astype(float))


def test_corners_are_found_where_they_lie():
    """Also the half pixel: an error of 0.5 px in both coordinates would be ten times the bound."""
    rig = studio(3, size=(480, 360), focal=525)
    poses = carried(4, facing=np.array([0, 0.4, -0.3]))[1:]
    directions, errors = rays(rig, 0), []
    for R, t in poses:
        found = BOARD.detect(render(rig, 0, [rectangle(R, t)], directions))
        assert np.isfinite(found).all(-1).mean() > 0.7
        errors.append((found - project(rig, BOARD.corners() @ R.T + t)[0][0])[np.isfinite(found).all(-1)])
    assert np.abs(np.concatenate(errors).mean(0)).max() < 0.05
    assert np.linalg.norm(np.concatenate(errors), axis=1).mean() < 0.15
    assert np.isnan(BOARD.detect(np.full((480, 640, 3), 128, np.uint8))).all()


@pytest.mark.slow
def test_a_rig_from_pictures():
    arc = ring(12, size=(640, 480), focal=700, height=0.8, above=1.3).subset(range(3))  # 30° apart, so that one board serves all
    rig = replace(studio(3, size=(640, 480), focal=700), R=arc.R, t=arc.t, size=arc.size)
    poses = carried(9, facing=np.linspace(-0.1, 1.1, 8))
    views = ((k, rays(rig, k, samples=2)) for k in range(3))
    uv = np.stack([[BOARD.detect(render(rig, k, [rectangle(R, t)], d)) for R, t in poses] for k, d in views])
    found = calibrate(rig, uv, floor_frame=0)
    degrees, mm = pose_errors(found.cameras, rig)
    print(found.residual_px, volume_error(found.cameras, rig), degrees, mm)
    assert found.residual_px.max() < 0.5
    assert volume_error(found.cameras, rig).max() < 3  # nine boards; a hand-held session has fifty
    assert degrees.max() < 2
    assert mm.max() < 40
