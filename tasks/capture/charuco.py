"""A rig calibrated with a ChArUco board that is carried through the volume.

    min over lenses, cameras, boards   Σ ρ(‖uv_kfc − project_k(R_f X_c + t_f)‖²),   ρ = soft L1 at 1 px

Corners are OpenCV's, refined to subpixels (Garrido-Jurado et al. 2014; +0.5 px, since OpenCV counts pixel centres as integers). Start:
each camera's lens by Zhang (2000), then poses handed on from camera to board to camera along the pairs that share the most corners. The
board gives the scale; its world is fixed by a frame in which it lies on the floor, face up, or by `levelled`.

Limits: k3 = 0; every camera needs `MIN_VIEWS` boards in different tilts, and a chain of shared boards to the first. Cameras and board
must be synchronised, or the board at rest.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from tasks.capture.rig_calibration import RigCalibration, levelled, moved
from tasks.geometry.cameras import Cameras, project
from tasks.geometry.faults import Fault, refuse
from tasks.geometry.rotations import matrix_from_axis_angle

Array = NDArray[np.float64]
Boards = tuple[Array, Array]  # R [frame, 3, 3] and t [frame, 3] of x = R x_board + t
MIN_VIEWS = 3  # Zhang's method needs two; the third tells a good one from a bad one
MIN_CORNERS = 8  # per view: a pose and something to check it by
LENS, POSE = 8, 6  # fx fy cx cy k1 k2 p1 p2; rotation vector and translation
FLOOR = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # the board's z points into it


@dataclass(frozen=True)
class Board:
    """Squares across and down, sides of square and marker in metres, and the name of OpenCV's marker dictionary."""

    columns: int
    rows: int
    square_m: float
    marker_m: float
    dictionary: str = "DICT_5X5_250"

    def corners(self) -> Array:
        """Inner chessboard corners [corner, 3] m: x along columns, y down the rows, z into the board."""
        return np.asarray(self._opencv().getChessboardCorners(), float)

    def picture(self, pixels_per_square: int) -> NDArray[np.uint8]:
        """The board to print [height, width], without a margin."""
        return self._opencv().generateImage((self.columns * pixels_per_square, self.rows * pixels_per_square))

    def detect(self, rgb: NDArray[np.uint8]) -> Array:
        """Corner positions [corner, 2] px in a picture [height, width, 3]; NaN where a corner was not found."""
        found = np.full((len(self.corners()), 2), np.nan)
        uv, numbers, _, _ = cv2.aruco.CharucoDetector(self._opencv()).detectBoard(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY))
        if numbers is not None and len(numbers):
            found[np.ravel(numbers)] = np.reshape(uv, (-1, 2)) + 0.5
        return found

    def markers(self) -> "cv2.aruco.Dictionary":
        """OpenCV's dictionary of that name."""
        return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))

    def _opencv(self) -> "cv2.aruco.CharucoBoard":
        return cv2.aruco.CharucoBoard((self.columns, self.rows), self.square_m, self.marker_m, self.markers())


def board_faults(board: Board) -> list[Fault]:
    """What makes it a board that nobody can print, or of which no view would do."""
    squares, most, faults = f"it has {board.columns} x {board.rows} squares", len(board.markers().bytesList), []
    if max(board.columns - 1, 0) * max(board.rows - 1, 0) < MIN_CORNERS:
        faults.append(Fault("board", squares, f"A view needs {MIN_CORNERS} corners at which four of them meet: 5 x 3 or more."))
    elif board.columns * board.rows // 2 > most:
        faults.append(Fault("board", squares, f"Every other one shows a marker, and {board.dictionary} has {most}."))
    if not 0 < board.marker_m < board.square_m < 1:
        remedy = "Give both in metres, the marker's side less than its square's and that less than 1."
        faults.append(Fault("board", f"it has markers of {board.marker_m:g} m on squares of {board.square_m:g} m", remedy))
    return faults


def calibrate_charuco(
    uv: Array, board: Board, *, names: Sequence[str], size: NDArray[np.int32], floor_frame: int | None = None
) -> RigCalibration:
    """The rig from corner positions uv [camera, frame, corner, 2] px (NaN: not seen, see `Board.detect`) and picture sizes [camera, 2].

    `floor_frame` is a frame in which the board lies on the floor: its plane becomes y = 0 and its first corner's square the origin.
    Raises BadInput for cameras that saw too little or share no board with the others.
    """
    X = board.corners()
    uv = np.stack([[_plausible(frame, X, 0.01 * max(s)) for frame in frames] for frames, s in zip(uv, size, strict=True)])
    views = np.isfinite(uv).all(-1).any(-1)
    refuse(_view_faults(views, names, floor_frame))
    rig = _lenses(uv, X, tuple(names), np.asarray(size, np.int32))
    rig, boards = _chain(rig, uv, X)
    rig, boards = _adjust(rig, boards, uv, X)
    error = np.linalg.norm(_reproject(rig, boards, X) - uv, axis=-1)
    world = levelled(rig) if floor_frame is None else _on_floor(rig, boards[0][floor_frame], boards[1][floor_frame])
    return RigCalibration(world, np.sqrt(np.nanmean(error**2, axis=(1, 2))), np.isfinite(error).sum((1, 2)))


def _plausible(uv: Array, X: Array, tolerance: float) -> Array:
    """One view's corners without those that no picture of a plane explains to `tolerance` px; none if too few are left.

    The tolerance leaves room for the bend of a lens within one board; the soft loss deals with what is smaller.
    """
    seen, kept = np.isfinite(uv).all(-1), np.full_like(uv, np.nan)
    if np.count_nonzero(seen) >= MIN_CORNERS:
        H, inlier = cv2.findHomography(X[seen, :2], uv[seen], cv2.RANSAC, tolerance)
        good = np.flatnonzero(seen)[np.ravel(inlier) > 0] if H is not None else []
        if len(good) >= MIN_CORNERS:
            kept[good] = uv[good]
    return kept


def _view_faults(views: NDArray[np.bool_], names: Sequence[str], floor_frame: int | None) -> list[Fault]:
    faults = []
    for name, count in zip(names, views.sum(1), strict=True):
        if count < MIN_VIEWS:
            what = f"the board was found in {count} frames with {MIN_CORNERS} corners or more"
            faults.append(Fault(name, what, f"Show it in {MIN_VIEWS} or more, near, tilted and sharp."))
    reached = views[0].copy()
    for _ in names:  # each pass reaches the cameras one board further away
        reached |= views[(views & reached).any(1)].any(0)
    alone = [n for n, row in zip(names, views, strict=True) if row.any() and not (row & reached).any()]
    faults += [
        Fault(n, f"shares no view of the board, even by way of others, with {names[0]}", "Show the board to both at once.") for n in alone
    ]
    if floor_frame is not None and not (0 <= floor_frame < views.shape[1] and views[:, floor_frame].any()):
        faults.append(
            Fault("floor_frame", f"no camera saw the board in frame {floor_frame}", "Choose a frame with the board on the floor.")
        )
    return faults


def _lenses(uv: Array, X: Array, names: tuple[str, ...], size: NDArray[np.int32]) -> Cameras:
    """Each camera's K and distortion by itself; poses are still those of no camera."""
    K, distortion = np.zeros((len(names), 3, 3)), np.zeros((len(names), 5))
    for k in range(len(names)):
        seen = [np.isfinite(frame).all(-1) for frame in uv[k]]
        objects = [X[s].astype(np.float32) for s in seen if s.any()]
        pictures = [(frame[s] - 0.5).astype(np.float32) for frame, s in zip(uv[k], seen, strict=True) if s.any()]
        _, K[k], d, _, _ = cv2.calibrateCamera(objects, pictures, tuple(size[k].tolist()), None, None, flags=cv2.CALIB_FIX_K3)
        K[k, :2, 2] += 0.5
        distortion[k] = np.ravel(d)[:5]
    return Cameras(names, K, np.tile(np.eye(3), (len(names), 1, 1)), np.zeros((len(names), 3)), size, distortion)


def _chain(rig: Cameras, uv: Array, X: Array) -> tuple[Cameras, Boards]:
    """Poses of cameras, and of the board per frame, in the first camera's axes; the strongest pair with one placed side goes first."""
    weight = np.isfinite(uv).all(-1).sum(-1)
    cameras, boards = {0: (np.eye(3), np.zeros(3))}, {}
    while True:
        open_pairs = [(k, f) for k, f in np.argwhere(weight) if (k in cameras) != (f in boards)]
        if not open_pairs:
            break
        k, f = max(open_pairs, key=lambda pair: weight[*pair])
        R, t = _board_pose(rig, k, uv[k, f], X)  # x_cam = R X + t
        if k in cameras:
            A, a = cameras[k]
            boards[f] = (A.T @ R, A.T @ (t - a))
        else:
            B, b = boards[f]
            cameras[k] = (R @ B.T, t - R @ B.T @ b)
    R, t = (np.stack([cameras[k][i] for k in range(len(rig))]) for i in (0, 1))
    unseen = (np.eye(3), np.array([0.0, 0, 1]))
    listed = [boards.get(f, unseen) for f in range(uv.shape[1])]
    return replace(rig, R=R, t=t), (np.stack([R for R, _ in listed]), np.stack([t for _, t in listed]))


def _board_pose(rig: Cameras, k: int, uv: Array, X: Array) -> tuple[Array, Array]:
    seen = np.isfinite(uv).all(-1)
    K = rig.K[k] - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
    # not SOLVEPNP_IPPE: OpenCV 5.0.0 was seen to return a pose 109° off for exact corners of a board on the floor
    _, r, t = cv2.solvePnP(X[seen], uv[seen] - 0.5, K, rig.distortion[k], flags=cv2.SOLVEPNP_ITERATIVE)
    return cv2.Rodrigues(r)[0], np.ravel(t)


def _adjust(rig: Cameras, boards: Boards, uv: Array, X: Array) -> tuple[Cameras, Boards]:
    """Bundle adjustment of everything at once; rotations as exp([ω]ₓ) R₀, the first camera fixed."""
    seen, n = np.isfinite(uv).all(-1), len(rig)
    start = np.zeros((LENS + POSE) * n + POSE * len(boards[0]))
    start[: LENS * n] = np.concatenate([rig.K[:, [0, 1], [0, 1]], rig.K[:, :2, 2], rig.distortion[:, :4]], axis=1).ravel()

    def unpack(p: Array) -> tuple[Cameras, Boards]:
        lens, pose, board = (
            p[: LENS * n].reshape(n, LENS),
            p[LENS * n : (LENS + POSE) * n].reshape(n, POSE),
            p[(LENS + POSE) * n :].reshape(-1, POSE),
        )
        K = np.tile(np.eye(3), (n, 1, 1))
        K[:, 0, 0], K[:, 1, 1], K[:, :2, 2] = lens[:, 0], lens[:, 1], lens[:, 2:4]
        free = np.arange(n)[:, None] > 0
        R, t = matrix_from_axis_angle(pose[:, :3] * free) @ rig.R, rig.t + pose[:, 3:] * free
        held = matrix_from_axis_angle(board[:, :3]) @ boards[0], boards[1] + board[:, 3:]
        return replace(rig, K=K, R=R, t=t, distortion=np.pad(lens[:, 4:], ((0, 0), (0, 1)))), held

    def residual(p: Array) -> Array:
        return np.nan_to_num((_reproject(*unpack(p), X) - uv)[seen], nan=1e3).ravel()  # a corner behind its camera is as wrong as can be

    def jacobian(p: Array) -> Array:
        return _differences(residual, p, seen)

    found = least_squares(residual, start, jacobian, x_scale="jac", loss="soft_l1", f_scale=1.0, ftol=1e-9, xtol=1e-9, max_nfev=200)
    return unpack(found.x)


def _differences(residual: Callable[[Array], Array], p: Array, seen: NDArray[np.bool_]) -> Array:
    """Forward differences. A corner depends on its camera's lens and pose and its frame's board: 20 probes serve all parameters."""
    k, f, _ = (np.repeat(i, 2) for i in np.nonzero(seen))
    n, rows = len(seen), np.arange(2 * np.count_nonzero(seen))
    J, r = np.zeros((len(rows), len(p))), residual(p)
    for first, width, owner in ((0, LENS, k), (LENS * n, POSE, k), ((LENS + POSE) * n, POSE, f)):
        for i in range(width):
            columns = first + width * np.arange(owner.max() + 1) + i
            h = np.zeros(len(p))
            h[columns] = 1e-6 * np.maximum(1, np.abs(p[columns]))
            J[rows, columns[owner]] = (residual(p + h) - r) / h[columns[owner]]
    return J


def _reproject(rig: Cameras, boards: Boards, X: Array) -> Array:
    """uv [camera, frame, corner, 2]."""
    R, t = boards
    return project(rig, np.einsum("fij,cj->fci", R, X) + t[:, None])[0]


def _on_floor(rig: Cameras, R: Array, t: Array) -> Cameras:
    """x = R X + t on the board; the world's axes are x_board, −z_board, y_board."""
    turn = FLOOR @ R.T
    return moved(rig, turn, -turn @ t)
