"""Additive continuous collision detection: how far points may move until a pair of primitives is nearer than a tenth of its gap.

With the mean displacement taken off, two primitives approach by no more than l_p = max‖p_a‖ + max‖p_b‖ per unit of the way. So from
distance d at share t they stay apart until

    t + s (d − ξ)/l_p,                   ξ: distance to be kept,  s = 0.9

and such steps are added up until d − ξ is less than (1 − s) of what it was at the start, or the way is done. Pairs whose boxes at the start
are too far apart for that are passed over without a distance.

Source: Li, Kaufman, Jiang 2021 (Codim-IPC), Algorithm 1. Held to ipctk's by test.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tasks.geometry.simplex_distances import along, between_segments, dot, length, minus, plus, point_triangle, scaled

Array = NDArray[np.float64]
Indices = NDArray[np.int32]


@njit(cache=True, nogil=True, error_model="numpy")
def free_share(
    X: Array, Y: Array, edges: Indices, faces: Indices, edge_edge: Indices, face_vertex: Indices, keep: float, kept_share: float
) -> float:
    """Largest share of the segment X → Y [V, 3] m on which every pair keeps `kept_share` of what it has beyond the distance `keep` [m];
    1 when all of it does.

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
            near_faces[n] = point_triangle(_at(X, v), _at(X, a), _at(X, b), _at(X, c)) <= reach**2
    return edge_edge[near_edges], face_vertex[near_faces]


@njit(cache=True, nogil=True, error_model="numpy")
def _reached(X, Y, a, b, c, d, of_point, keep, s, most):
    """The share at which a pair has lost s of what it has beyond `keep`; infinite if not by `most`."""
    p, q = (_at(X, a), _at(X, b), _at(X, c), _at(X, d)), (_at(Y, a), _at(Y, b), _at(Y, c), _at(Y, d))
    u0, u1, u2, u3 = minus(q[0], p[0]), minus(q[1], p[1]), minus(q[2], p[2]), minus(q[3], p[3])
    mean = scaled(0.25, plus(plus(u0, u1), plus(u2, u3)))
    u0, u1, u2, u3 = minus(u0, mean), minus(u1, mean), minus(u2, mean), minus(u3, mean)
    l0, l1, l2, l3 = length(u0), length(u1), length(u2), length(u3)
    way = l0 + max(l1, l2, l3) if of_point else max(l0, l1) + max(l2, l3)
    if way == 0:
        return np.inf
    p0, p1, p2, p3 = p
    gap = np.sqrt(_squared(p0, p1, p2, p3, of_point)) - keep
    if not gap > 0:
        return 0.0
    least, t = (1 - s) * gap, 0.0
    while True:
        step = s * gap / way
        p0, p1, p2, p3 = along(p0, step, u0), along(p1, step, u1), along(p2, step, u2), along(p3, step, u3)
        gap = np.sqrt(_squared(p0, p1, p2, p3, of_point)) - keep
        if t > 0 and gap < least:
            return t
        t += step
        if not t <= most:  # nor where a way that is not finite led nowhere
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
def _squared(a, b, c, d, of_point):
    return point_triangle(a, b, c, d) if of_point else _segments(a, b, c, d)


@njit(cache=True, nogil=True, error_model="numpy")
def _segments(a, b, c, d):
    r = between_segments(a, b, c, d)
    return dot(r, r)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _at(X, v):
    return X[v, 0], X[v, 1], X[v, 2]
