"""A sleeveless top in two panels: a cylinder over the convex hull of the chest, held by two straps over the shoulders.

The cylinder unrolls exactly (u = arc length along the hull, v = height). A strap leaves the cylinder's upper edge as it lies there and
within `TURN_OUT` of length comes to run in a plane x = const over the shoulder, which is again a cylinder. Between the two it is
stretched as sewn, by up to 15 % in a few triangles (`garments.pattern_strain`); the rest shape is the pattern, so settling undoes it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.capture.demo.garments import Garment, Panel, sew
from tasks.capture.demo.hulls import arc_length, bridge, hull_curve
from tasks.capture.demo.panels import sample, triangulate

Array = NDArray[np.float64]

TURN_OUT = 0.14  # [m] of strap
HELD = 0.035  # [m] of strap on either side of the shoulder seam that the body carries


@dataclass(frozen=True)
class TopCut:
    """Heights of hem and upper edge, distance of the straps from the middle, their width, ease of chest and straps [m]."""

    hem: float
    upper_edge: float
    strap_place: float
    strap_width: float = 0.05
    ease: float = 0.007
    strap_ease: float = 0.014


@dataclass(frozen=True)
class _Side:
    """Front or back: chest curve [P, 2] (x, z) m with arc length u [P] from the middle, and the straps as (u of the middle, x, path)."""

    curve: Array
    u: Array
    straps: tuple[tuple[float, float, Array], ...]


def top(body: Array, cut: TopCut, *, spacing: float, rng: np.random.Generator) -> Garment:
    """The top around the points body [P, 3] m (arms and head left out), standing and facing +z. Its boundary: the straps' shoulder ends."""
    panels = []
    for side in _sides(body, cut):
        points, faces = triangulate(_outline(side, cut, spacing), spacing, rng)
        place, held = _place(points, side, cut)
        panels.append(Panel(points, faces, place, held))
    return sew("top", panels)


def _sides(body: Array, cut: TopCut) -> tuple[_Side, _Side]:
    around = body[(body[:, 1] > cut.hem - 0.01) & (body[:, 1] < cut.upper_edge + 0.02)][:, [0, 2]]
    chest = hull_curve(around, cut.ease)
    half = len(chest) // 2
    halves = chest[: half + 1], chest[half:]
    lengths = [arc_length(curve) - arc_length(curve)[-1] / 2 for curve in halves]
    straps: tuple[list, list] = ([], [])
    for x in (-cut.strap_place, cut.strap_place):
        u = [float(np.interp(x, *_rising(curve[:, 0], s))) for curve, s in zip(halves, lengths)]
        ends = [np.array([np.interp(u[k], lengths[k], halves[k][:, 1]), cut.upper_edge]) for k in (0, 1)]
        near = body[(np.abs(body[:, 0] - x) < cut.strap_width / 2 + 0.01) & (body[:, 1] > cut.upper_edge)]
        path = bridge(ends[0], ends[1], near[:, [2, 1]], ease=cut.strap_ease)
        peak = int(path[:, 1].argmax())
        straps[0].append((u[0], x, path[: peak + 1]))
        straps[1].append((u[1], x, path[peak:][::-1]))
    front, back = (_Side(halves[k], lengths[k], tuple(sorted(straps[k]))) for k in (0, 1))
    return front, back


def _outline(side: _Side, cut: TopCut, spacing: float) -> Array:
    """Counter-clockwise: hem, right seam, upper edge with straps from right to left, left seam."""
    U, V, w = side.u[-1], cut.upper_edge - cut.hem, cut.strap_width / 2
    corners = [(-U, 0.0), (U, 0.0), (U, V)]
    for u, _, path in reversed(side.straps):
        end = V + arc_length(path)[-1]
        corners += [(u + w, V), (u + w, end), (u - w, end), (u - w, V)]
    corners += [(-U, V)]
    closed = np.array([*corners, corners[0]])
    return np.concatenate([sample(closed[k : k + 2], spacing)[:-1] for k in range(len(corners))])


def _place(points: Array, side: _Side, cut: TopCut) -> tuple[Array, NDArray[np.bool_]]:
    """Places [P, 3] m on the body and which points [P] lie on the held ends of the straps."""
    u, rise = points[:, 0], points[:, 1] - (cut.upper_edge - cut.hem)
    x, z = (np.interp(u, side.u, column) for column in side.curve.T)
    place, held = np.stack([x, cut.hem + points[:, 1], z], 1), np.zeros(len(points), bool)
    across = 1.0 if side.curve[-1, 0] > 0 else -1.0  # u runs along +x at the front and along −x at the back
    for middle, strap_x, path in side.straps:
        on = (rise > 1e-9) & (np.abs(u - middle) < cut.strap_width / 2 + 1e-9)
        s, keep = arc_length(path), 1 - _smooth(rise[on] / TURN_OUT)
        path_z, path_y = (np.interp(rise[on], s, column) for column in path.T)
        lean = keep * (z[on] - np.interp(middle, side.u, side.curve[:, 1]))
        out_z, out_y = _outwards(path, rise[on], keep)
        straight = strap_x + across * (u[on] - middle)
        place[on] = np.stack([keep * x[on] + (1 - keep) * straight, path_y + lean * out_y, path_z + lean * out_z], 1)
        held[on] = rise[on] > s[-1] - HELD
    return place, held


def _outwards(path: Array, s: Array, keep: Array) -> Array:
    """Direction (z, y) [2, P] in which the strap leans: along z where it leaves the chest, then at right angles to its path."""
    slope = np.gradient(path, arc_length(path), axis=0)
    z, y = (np.interp(s, arc_length(path), column) for column in slope.T)
    out = np.stack([y, -z]) * np.sign(y[:1].sum())
    out = keep * np.array([[1.0], [0.0]]) + (1 - keep) * out
    return out / np.linalg.norm(out, axis=0)


def _rising(x: Array, y: Array) -> tuple[Array, Array]:
    return (x, y) if x[-1] > x[0] else (x[::-1], y[::-1])


def _smooth(s: Array) -> Array:
    s = np.clip(s, 0, 1)
    return s * s * (3 - 2 * s)
