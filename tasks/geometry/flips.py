"""The same surface in other triangles: diagonals of neighbouring faces exchanged, each face at most once.

Of two faces (a, b, c) and (b, a, d) that are nearly coplanar come (a, d, c) and (d, b, c). The shortest new diagonals, relative to the old
ones, are taken first: on a grid of squares these are the other diagonals, of which none is worse. Source: Lawson 1972.
"""

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.meshes import edges, hinges

Array = NDArray[np.float64]
Indices = NDArray[np.int32]

LONGER = 1.5  # a new diagonal may be so many times as long as the old one
INSIDE = 0.15  # and must cross it so far from its ends, as a share of it
FLAT = 0.9  # cosine between normals of faces that count as coplanar


def flip(vertices: Array, faces: Indices, corners: Array | None = None) -> tuple[Indices, Array | None]:
    """Faces [F, 3] of the vertices [V, 3] m with other diagonals, and the pattern's places [F, 3, 2] m of their corners (None: no pattern).

    Edges along which corners of the two faces differ (seams) stay, and diagonals that do not cross in the pattern, where worn cloth may
    have other shapes.
    """
    found, values = faces.copy(), None if corners is None else corners.copy()
    taken, there = np.zeros(len(faces), bool), {tuple(e) for e in np.sort(edges(faces), 1).tolist()}
    for i, j, a, b, c, d in _candidates(vertices, faces).tolist():
        other = (min(c, d), max(c, d))
        if taken[i] or taken[j] or other in there:
            continue
        if values is not None:
            one, two = dict(zip(faces[i].tolist(), corners[i], strict=True)), dict(zip(faces[j].tolist(), corners[j], strict=True))
            if not (np.allclose(one[a], two[a]) and np.allclose(one[b], two[b])):
                continue
            if not _cross(one[a], one[b], one[c], two[d]):
                continue
            values[i], values[j] = (one[a], two[d], one[c]), (two[d], one[b], one[c])
        found[i], found[j] = (a, d, c), (d, b, c)
        taken[[i, j]] = True
        there.add(other)
    return found, values


def _cross(a: Array, b: Array, c: Array, d: Array) -> bool:
    """Whether c → d crosses a → b in the plane, so far from its ends as `INSIDE` says."""
    left, right = (_twice_area(a, b, p) for p in (c, d))
    if left * right >= 0:
        return False
    at = c + left / (left - right) * (d - c)
    share = float((at - a) @ (b - a) / ((b - a) @ (b - a)))
    return INSIDE < share < 1 - INSIDE


def _twice_area(a: Array, b: Array, c: Array) -> float:
    """Of a triangle in the plane, negative where it is seen from behind."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _candidates(x: Array, faces: Indices) -> Indices:
    """Pairs of faces i, j and their corners [H, 6] = (i, j, a, b, c, d) that may exchange a diagonal, best first."""
    h = hinges(faces)
    if not len(h):
        return np.empty((0, 6), np.int32)
    of = {frozenset(f): k for k, f in enumerate(faces.tolist())}
    pair = np.array([[of[frozenset((a, b, c))], of[frozenset((a, b, d))]] for a, b, c, d in h.tolist()])
    a, b, c, d = (x[h[:, k]] for k in range(4))
    long = np.linalg.norm(b - a, axis=1)
    e = (b - a) / long[:, None]
    n1, n2 = np.cross(b - a, c - a), np.cross(d - a, b - a)
    cosine = np.sum(n1 * n2, 1) / (np.linalg.norm(n1, axis=1) * np.linalg.norm(n2, axis=1))
    (s, u), (t, v) = (_along(p - a, e) for p in (c, d))
    crossing = (s * v + t * u) / ((u + v) * long)  # where c → d meets a → b once both faces lie in one plane
    ratio = np.hypot(s - t, u + v) / long
    good = (cosine > FLAT) & (ratio < LONGER) & (crossing > INSIDE) & (crossing < 1 - INSIDE)
    order = np.flatnonzero(good)[np.argsort(np.round(ratio[good], 9), kind="stable")]
    return np.column_stack([pair, h])[order]


def _along(p: Array, e: Array) -> tuple[Array, Array]:
    """Coordinates [H] of points along the unit vectors e, and their distances [H] from them."""
    s = np.sum(p * e, 1)
    return s, np.linalg.norm(p - s[:, None] * e, axis=1)
