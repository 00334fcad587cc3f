"""The recorded sleeve as a model: its measured pattern sewn into a tube, two clamps, and the arm as a tapered plate posed from its two
sensors.

Pattern, centimetres, transcribed in the data's README 1.5: per row of places the distances raw edge – left – middle – right – fold, and
along the columns the distances between rows. One layer of the tube; the seam runs 1.5 cm inside the raw edge. Lengths below in metres.
"""

from dataclasses import dataclass

import numpy as np

from tasks.simulator import Cloth, Collider, Fabric
from tests.real.sleeve_recording import AXIS, DOWN, PIVOT, Run, arm_frame

ACROSS = np.array([[2.9, 6.3, 5.3, 3.6], [2.6, 5.3, 4.8, 3.3], [2.3, 4.9, 4.9, 2.4], [2.2, 4.0, 4.2, 2.5], [2.3, 4.0, 3.6, 2.3]]) / 100
ALONG = (
    np.array([[6.3, 7.9, 8.1, 8.9, 7.7, 8.8], [9.6, 7.8, 8.5, 8.9, 8.3, 8.9], [12.4, 7.3, 8.9, 8.7, 8.5, 9.4]]) / 100
)  # left, middle, right
ALLOWANCE = 0.015
HEM = 0.115
ROW_1 = 0.1145  # [m] from the pivot along the arm: mean of places 1 to 3
S1, S2 = 0.1307, 0.3569  # [m] of the sensors from the pivot
ARM = np.array([[-0.015, 0.072], [0.125, 0.063], [0.249, 0.081], [0.345, 0.062], [0.4615, 0.0495]])  # from the pivot, width [m]
ELBOW = 0.249
PLATE = 0.008  # [m] thickness, not recorded
CLAMPS = {"seam": -0.05, "fold": -0.10}  # [m] along the arm from row 1, read off a photograph: several centimetres of doubt
JERSEY = Fabric.from_si(areal_density=0.23, stretch=120.0, bending_rigidity=8e-6, friction=0.3)  # stiffness: a soft knit, not measured


@dataclass(frozen=True)
class Sleeve:
    """cloth (clamped nodes are its boundary); x_arm [V, 3] m: start in the frame of the straight arm (along, across, out; origin the
    pivot); places {number: (nodes [4], weights [4])}.
    """

    cloth: Cloth
    x_arm: np.ndarray
    places: dict[int, tuple[np.ndarray, np.ndarray]]


def sleeve(*, around: int = 11, along: int = 25) -> Sleeve:
    """The tube with `around` cells per layer and `along` cells from top to hem."""
    pattern, u, v = _pattern(around, along)
    n = along + 1
    index = np.concatenate([np.arange(around + 1), np.arange(around - 1, 0, -1)])  # columns of the pattern around the tube
    layer = np.concatenate([np.ones(around + 1), -np.ones(around - 1)])
    ring = len(index)
    arc = np.concatenate([np.linspace(0, np.pi, around + 1), np.linspace(np.pi, 2 * np.pi, around + 1)[1:-1]])
    width = pattern[:, -1, 0] - pattern[:, 0, 0]
    radius = (width / np.pi)[:, None]
    y = pattern[:, index, 1]
    x_arm = np.stack([ROW_1 + y, -radius * np.cos(arc), radius * np.sin(arc)], -1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(n - 1), np.arange(ring), indexing="ij")
    a, b, c, d = (np.ravel((i + p) * ring + (j + q) % ring) for p, q in ((0, 0), (1, 0), (1, 1), (0, 1)))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)
    column = np.ravel(j)
    flat = _flat(pattern, index, layer, column, np.ravel(i))
    uv = np.concatenate([flat[:, [0, 1, 2]], flat[:, [0, 2, 3]]])
    held = np.concatenate([_near(x_arm, y.ravel(), k, ring, along) for k in ((0, CLAMPS["seam"]), (around, CLAMPS["fold"]))])
    return Sleeve(Cloth(x_arm, faces, np.unique(held), uv=uv, rest_angles="flat"), x_arm, _places(u, v, ring))


def arm_plate(*, cells: int = 12) -> tuple[np.ndarray, Collider]:
    """The arm [C, 3] m in its own frame as a closed box with tapered sides, and its faces."""
    r = np.unique(np.concatenate([np.linspace(ARM[0, 0], ARM[-1, 0], cells), [ELBOW]]))
    half = np.interp(r, ARM[:, 0], ARM[:, 1]) / 2
    corner = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    x = np.stack([np.repeat(r[:, None], 4, 1), half[:, None] * corner[:, 0], np.full((len(r), 4), PLATE / 2) * corner[:, 1]], -1).reshape(
        -1, 3
    )
    i, j = np.meshgrid(np.arange(len(r) - 1), np.arange(4), indexing="ij")
    a, b, c, d = (np.ravel((i + p) * 4 + (j + q) % 4) for p, q in ((0, 0), (1, 0), (1, 1), (0, 1)))
    end = 4 * (len(r) - 1)
    caps = [[0, 2, 1], [0, 3, 2], [end, end + 1, end + 2], [end, end + 2, end + 3]]
    return x, Collider(np.concatenate([np.stack([a, c, b], 1), np.stack([a, d, c], 1), caps]))


def posed(x: np.ndarray, run: Run, *, link: int | None = None) -> np.ndarray:
    """Points x [n, 3] m of the arm's frame in the tracker's [T, n, 3] m: each on its link, upper arm from pivot to s1, forearm from s1 to s2."""
    upper = np.einsum("tij,ni->tnj", arm_frame(np.broadcast_to(PIVOT, run.s1.shape), run.s1), x - [S1, 0, 0]) + run.s1[:, None]
    fore = np.einsum("tij,ni->tnj", arm_frame(run.s1, run.s2), x - [S2, 0, 0]) + run.s2[:, None]
    on_upper = x[:, 0] < ELBOW if link is None else np.full(len(x), link == 1)
    return np.where(on_upper[None, :, None], upper, fore)


def at_rest(run: Run, frames: int) -> Run:
    """The arm hanging still for some frames."""
    s1, s2 = PIVOT + S1 * DOWN, PIVOT + S2 * DOWN
    return Run(np.zeros(frames), np.tile(s1, (frames, 1)), np.tile(s2, (frames, 1)), {})


def raised(run: Run, frames: int) -> Run:
    """From hanging to where the recording begins, smoothly, turning about the pivot."""
    share = (1 - np.cos(np.linspace(0, np.pi, frames))) / 2
    start = np.stack([run.s1[0], run.s2[0]]) - PIVOT
    angles = [np.arctan2(v @ np.cross(AXIS, DOWN), v @ DOWN) for v in start]
    turned = []
    for v, angle in zip(start, angles):
        across = v @ AXIS
        length = np.linalg.norm(v - across * AXIS)
        a = share * angle
        turned.append(
            PIVOT + length * (np.cos(a)[:, None] * DOWN + np.sin(a)[:, None] * np.cross(AXIS, DOWN)) + (share * across)[:, None] * AXIS
        )
    return Run(np.zeros(frames), turned[0], turned[1], {})


def joined(*runs: Run) -> Run:
    """One motion after the other."""
    return Run(*(np.concatenate([getattr(r, name) for r in runs]) for name in ("time", "s1", "s2")), {})


def _pattern(around: int, along: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Grid [along + 1, around + 1, 2] m of one layer, y 0 at row 1 and down; u, v: where each control column and row lies in grid cells."""
    row_y = np.cumsum(np.concatenate([-ALONG[:, :1], ALONG], 1), 1)  # [column, top, row 1, …, row 5, hem]
    y = np.stack([row_y[0], row_y[0], row_y[1], row_y[2], row_y[2]], 1)
    left, middle, right, fold = ACROSS.T
    x = np.stack([-(left + middle) + ALLOWANCE, -middle, 0 * middle, right, right + fold], 1)
    top = x[0] + (x[0] - x[1]) * (ALONG[1, 0] / ALONG[1, 1])
    hem = x[-1] * HEM / np.ptp(x[-1] - [ALLOWANCE, 0, 0, 0, 0])
    x = np.concatenate([top[None], x, hem[None]])
    u_control = np.linspace(0, around, 5)
    v_control = np.concatenate([[0], np.cumsum(ALONG[1])]) / ALONG[1].sum() * along
    u, v = np.arange(around + 1), np.arange(along + 1)
    grid = np.empty((along + 1, around + 1, 2))
    for k, values in enumerate((x, y)):
        rows = np.stack([np.interp(v, v_control, values[:, c]) for c in range(5)], 1)
        grid[..., k] = np.stack([np.interp(u, u_control, row) for row in rows])
    return grid, u_control, v_control


def _flat(pattern: np.ndarray, index: np.ndarray, layer: np.ndarray, column: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Flat corners [cell, 4, 2] of every cell, the back layer mirrored so that orientation is kept."""
    after = (column + 1) % len(index)
    back = (layer[column] < 0) | (layer[after] < 0)
    corners = [pattern[row + p, index[c]] for p, c in ((0, column), (1, column), (1, after), (0, after))]
    mirror = np.stack([np.where(back, -1.0, 1.0), np.full(len(back), -1.0)], 1)  # v counts upwards
    return np.stack(corners, 1) * mirror[:, None]


def _near(x: np.ndarray, y: np.ndarray, where: tuple[int, float], ring: int, along: int) -> np.ndarray:
    """The node of a tube column nearest to a height, with its neighbours below and beside: what a clamp holds."""
    column, height = where
    row = int(np.argmin(np.abs(y.reshape(along + 1, ring)[:, column] - height)))
    rows = np.clip([row, row + 1], 0, along)
    return np.array([r * ring + (column + side) % ring for r in rows for side in (-1, 0, 1)], np.int32)


def _places(u: np.ndarray, v: np.ndarray, ring: int) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Bilinear weights of the 14 measured places; all lie on the front layer."""
    found = {}
    for number in range(1, 15):
        row, column = divmod(number - 1, 3)
        a, b = u[column + 1], v[row + 1]
        i, j = int(b), int(a)
        s, t = b - i, a - j
        nodes = np.array([i * ring + j, (i + 1) * ring + j, i * ring + j + 1, (i + 1) * ring + j + 1])
        found[number] = nodes, np.array([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t])
    return found
