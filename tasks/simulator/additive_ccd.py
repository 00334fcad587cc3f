"""Additive continuous collision detection: how far points may move until a pair of primitives is nearer than a tenth of its gap.

With the mean displacement taken off, two primitives approach by no more than l_p = max‖p_a‖ + max‖p_b‖ per unit of the way. So from distance d at
share t they stay apart until

    t + s (d − ξ)/l_p,                   ξ: distance to be kept,  s = 0.9

and such steps are added up until d − ξ is less than (1 − s) of what it was at the start, or the way is done. Pairs whose boxes at the start are too far
apart for that are passed over without a distance.

Source: Li, Kaufman, Jiang 2021 (Codim-IPC), Algorithm 1; distances by Ericson 2005, §5.1.5 and 5.1.9. Held to ipctk's by test.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int32]


@njit(cache=True, nogil=True, error_model="numpy")
def free_share(
    X: Array, Y: Array, edges: Indices, faces: Indices, edge_edge: Indices, face_vertex: Indices, keep: float, kept_share: float
) -> float:
    """Largest share of the segment X → Y [V, 3] m on which every pair keeps `kept_share` of what it has beyond the distance `keep` [m]; 1 when all of it does.

    edges [E, 2], faces [F, 3]; edge_edge [N, 2], face_vertex [M, 2]: the pairs that are asked about.
    """
    share, s = 1.0, 1 - kept_share
    moved = np.empty(len(X))
    for v in range(len(X)):
        moved[v] = np.sqrt((Y[v, 0] - X[v, 0]) ** 2 + (Y[v, 1] - X[v, 1]) ** 2 + (Y[v, 2] - X[v, 2]) ** 2)
    for n in range(len(edge_edge)):
        a, b = edges[edge_edge[n, 0]]
        c, d = edges[edge_edge[n, 1]]
        way = max(moved[a], moved[b]) + max(moved[c], moved[d])
        if s * (_box_gap(X, (a, b), (c, d)) - keep) <= share * way:
            share = min(share, _reached(X, Y, a, b, c, d, False, keep, s, share))
    for n in range(len(face_vertex)):
        a, b, c = faces[face_vertex[n, 0]]
        v = face_vertex[n, 1]
        way = max(moved[a], moved[b], moved[c]) + moved[v]
        if s * (_box_gap(X, (a, b, c), (v, v)) - keep) <= share * way:
            share = min(share, _reached(X, Y, v, a, b, c, True, keep, s, share))
    return share


@njit(cache=True, nogil=True, error_model="numpy")
def nearer_than(
    X: Array, edges: Indices, faces: Indices, edge_edge: Indices, face_vertex: Indices, reach: float
) -> tuple[Indices, Indices]:
    """Those of the pairs that are nearer than `reach` [m] at X [V, 3] m."""
    near_edges, near_faces = np.zeros(len(edge_edge), np.bool_), np.zeros(len(face_vertex), np.bool_)
    for n in range(len(edge_edge)):
        a, b = edges[edge_edge[n, 0]]
        c, d = edges[edge_edge[n, 1]]
        if _box_gap(X, (a, b), (c, d)) <= reach:
            near_edges[n] = _segments(_at(X, a), _at(X, b), _at(X, c), _at(X, d)) <= reach**2
    for n in range(len(face_vertex)):
        a, b, c = faces[face_vertex[n, 0]]
        v = face_vertex[n, 1]
        if _box_gap(X, (a, b, c), (v, v)) <= reach:
            near_faces[n] = _point_triangle(_at(X, v), _at(X, a), _at(X, b), _at(X, c)) <= reach**2
    return edge_edge[near_edges], face_vertex[near_faces]


@njit(cache=True, nogil=True, error_model="numpy")
def _reached(X, Y, a, b, c, d, point_triangle, keep, s, most):
    """The share at which a pair has lost s of what it has beyond `keep`; infinite if not by `most`."""
    p, q = (_at(X, a), _at(X, b), _at(X, c), _at(X, d)), (_at(Y, a), _at(Y, b), _at(Y, c), _at(Y, d))
    u0, u1, u2, u3 = _minus(q[0], p[0]), _minus(q[1], p[1]), _minus(q[2], p[2]), _minus(q[3], p[3])
    mean = _scaled(0.25, _plus(_plus(u0, u1), _plus(u2, u3)))
    u0, u1, u2, u3 = _minus(u0, mean), _minus(u1, mean), _minus(u2, mean), _minus(u3, mean)
    l0, l1, l2, l3 = _length(u0), _length(u1), _length(u2), _length(u3)
    way = l0 + max(l1, l2, l3) if point_triangle else max(l0, l1) + max(l2, l3)
    if way == 0:
        return np.inf
    p0, p1, p2, p3 = p
    gap = np.sqrt(_squared(p0, p1, p2, p3, point_triangle)) - keep
    if gap <= 0:
        return 0.0
    least, t = (1 - s) * gap, 0.0
    while True:
        step = s * gap / way
        p0, p1, p2, p3 = _along(p0, step, u0), _along(p1, step, u1), _along(p2, step, u2), _along(p3, step, u3)
        gap = np.sqrt(_squared(p0, p1, p2, p3, point_triangle)) - keep
        if t > 0 and gap < least:
            return t
        t += step
        if t > most:
            return np.inf


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _box_gap(X, first, second):
    """Largest gap [m] along an axis between the boxes of two sets of vertices: no more than their distance."""
    gap = -np.inf
    for k in range(3):
        low_a = high_a = X[first[0], k]
        for v in first[1:]:
            low_a, high_a = min(low_a, X[v, k]), max(high_a, X[v, k])
        low_b = high_b = X[second[0], k]
        for v in second[1:]:
            low_b, high_b = min(low_b, X[v, k]), max(high_b, X[v, k])
        gap = max(gap, low_b - high_a, low_a - high_b)
    return gap


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _squared(a, b, c, d, point_triangle):
    return _point_triangle(a, b, c, d) if point_triangle else _segments(a, b, c, d)


@njit(cache=True, nogil=True, error_model="numpy")
def _point_triangle(p, a, b, c):
    """Squared distance of p from triangle abc."""
    ab, ac, ap = _minus(b, a), _minus(c, a), _minus(p, a)
    d1, d2 = _dot(ab, ap), _dot(ac, ap)
    if d1 <= 0 and d2 <= 0:
        return _dot(ap, ap)
    bp = _minus(p, b)
    d3, d4 = _dot(ab, bp), _dot(ac, bp)
    if d3 >= 0 and d4 <= d3:
        return _dot(bp, bp)
    cp = _minus(p, c)
    d5, d6 = _dot(ab, cp), _dot(ac, cp)
    if d6 >= 0 and d5 <= d6:
        return _dot(cp, cp)
    opposite_c, opposite_b, opposite_a = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
    if opposite_c <= 0 and d1 >= 0 and d3 <= 0:
        r = _along(ap, -d1 / (d1 - d3), ab)
    elif opposite_b <= 0 and d2 >= 0 and d6 <= 0:
        r = _along(ap, -d2 / (d2 - d6), ac)
    elif opposite_a <= 0 and d4 >= d3 and d5 >= d6:
        r = _along(bp, -(d4 - d3) / (d4 - d3 + d5 - d6), _minus(c, b))
    else:
        whole = opposite_a + opposite_b + opposite_c
        r = _along(_along(ap, -opposite_b / whole, ab), -opposite_c / whole, ac)
    return _dot(r, r)


@njit(cache=True, nogil=True, error_model="numpy")
def _segments(a, b, c, d):
    """Squared distance of segments ab and cd."""
    ab, cd, ca = _minus(b, a), _minus(d, c), _minus(a, c)
    A, E, f, C, B = _dot(ab, ab), _dot(cd, cd), _dot(cd, ca), _dot(ab, ca), _dot(ab, cd)
    det = A * E - B * B
    s = min(max((B * f - C * E) / det, 0.0), 1.0) if det > 1e-12 * A * E else 0.0
    t = (B * s + f) / E
    if t < 0:
        t, s = 0.0, min(max(-C / A, 0.0), 1.0)
    elif t > 1:
        t, s = 1.0, min(max((B - C) / A, 0.0), 1.0)
    r = _along(_along(ca, s, ab), -t, cd)
    return _dot(r, r)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _at(X, v):
    return X[v, 0], X[v, 1], X[v, 2]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _plus(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _scaled(t, a):
    return t * a[0], t * a[1], t * a[2]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _along(a, t, b):
    return a[0] + t * b[0], a[1] + t * b[1], a[2] + t * b[2]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _length(a):
    return np.sqrt(_dot(a, a))
