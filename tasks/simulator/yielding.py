"""Where a collider gives way: skin that meets skin would pinch cloth into nothing, and skin in front of a pinned node cannot be obeyed.

Three demands, each a depth [m] by which collider vertices are drawn in along their normals (c: clearance, two barrier distances and
the offset):

    penetration   skin inside another part of the collider, by p            p / (1 − n·m) + c
    narrow gap    skin that faces other skin at a distance g < 2c           ½ (2c − g), (2c − g) / ((n − m)·u)
    pins          a prescribed cloth node, or a point of an edge between
                  two of them, at signed distance σ < c                     c − σ

p is the distance to the nearest skin that looks elsewhere, m that skin's normal and n the vertex's own: both parts are drawn in to where
they are equally far from either, half of p each where they face one another. g is the distance along a vertex's normal, and the one along u
between two edges, for faces bent against one another are nearest there: in a gap of 2c with edges at c, two layers of cloth cannot lie a
barrier distance apart. σ of a covered pin is that to the skin behind which it lies; inside by the generalised winding number (Jacobson et
al. 2013). What was covered is examined again once drawn in, for creases and curved skin are left short by one pass; gaps are asked for
twice, at the end: where the bound holds one end of an edge the other makes up for it, but a crease is narrow however deep it is drawn in.

Penetration and gaps are given way to by at most ½ max p + c, pins by at most c − min σ. So a limb that another part has swallowed whole
stays there, and cloth around it is blocked. Only skin within 12 cm of the cloth gives way: mouths and fingers do not matter. Limits: no
deeper than 0.1 m; skin without thickness.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tasks.geometry.distances import closest_points, inside
from tasks.geometry.meshes import edges, face_normals, vertex_normals
from tasks.geometry.simplex_distances import between_segments

Array = NDArray[np.float64]
Indices = NDArray[np.int32]
REACH = 0.12  # [m], more than the deepest skin can lie behind cloth
MOST = 0.1  # [m]
PASSES = 8
GAP_PASSES = 2
BETWEEN = (0.25, 0.5, 0.75)  # places on an edge between pinned nodes that are kept clear
NO_EDGES = np.empty((0, 2), np.int32)
FACING = -0.2  # cosine of normals that look against one another
NOTHING = 1e-5  # [m] of penetration that is not worth another pass


@dataclass(frozen=True)
class Yielded:
    """How far each collider vertex was drawn in: depth [C] m."""

    depth: Array

    def __bool__(self) -> bool:
        return bool(self.depth.any())

    def __str__(self) -> str:
        if not self:
            return "the collider did not give way"
        worst = int(self.depth.argmax())
        return f"{np.count_nonzero(self.depth)} collider vertices gave way, at most {1e3 * self.depth[worst]:.1f} mm at vertex {worst}"


def give_way(
    collider: Array, faces: Indices, *, cloth: Array, pins: Array, clearance: float, held_edges: Indices = NO_EDGES
) -> tuple[Array, Yielded]:
    """The collider [C, 3] drawn in where it pinches itself near cloth [V, 3] or covers pins [B, 3] or the edges [J, 2] between them.

    faces [F, 3], clearance c [m]. Vertices of no face stay where they are.
    """
    if not len(faces):
        return collider, Yielded(np.zeros(len(collider)))
    collider = np.ascontiguousarray(collider)  # else kernels are compiled once more, for strides
    normals, e, held = vertex_normals(collider, faces), edges(faces), _along(pins, held_edges)
    near = np.intersect1d(np.flatnonzero(cKDTree(cloth).query(collider, distance_upper_bound=REACH)[0] < REACH), faces)
    under, p = _covered_depth(collider, faces, normals, near, clearance)
    pinned = pin_depth(collider, faces, held, clearance)
    most, most_pinned = min(0.5 * p + clearance, MOST), min(pinned.max(), MOST)
    depth = np.minimum(_ring_maximum(under, e), most)
    for _ in range(PASSES):
        before = depth
        depth = np.maximum(depth, np.minimum(depth + _ring_maximum(pinned, e), most_pinned))
        drawn = draw_in(collider, normals, depth)
        deep = near[depth[near] > 0]  # what has not moved is covered no more than it was
        under, p = _covered_depth(drawn, faces, normals, deep, 0.5 * clearance)
        pinned = pin_depth(drawn, faces, held, clearance)
        if p < NOTHING and pinned.max() < 0.5 * clearance:
            break
        depth = np.maximum(depth, np.minimum(depth + _ring_maximum(under, e), most))
        if np.array_equal(depth, before):  # as deep as it may
            break
    for _ in range(GAP_PASSES):
        narrow = _gap_depth(draw_in(collider, normals, depth), faces, e, normals, near, clearance)
        depth = np.maximum(depth, np.minimum(depth + _ring_maximum(narrow, e), most))
    return draw_in(collider, normals, depth), Yielded(depth)


def draw_in(collider: Array, normals: Array, depth: Array) -> Array:
    """Collider vertices moved inward along their normals by depth [C] m."""
    return collider - depth[:, None] * normals


def pin_depth(collider: Array, faces: Indices, pins: Array, clearance: float) -> Array:
    """Depth [C] demanded by pinned points [B, 3] that lie under the skin or on it."""
    depth = np.zeros(len(collider))
    if not len(pins):
        return depth
    closest = closest_points(pins, collider, faces)
    σ, face = closest.distance, closest.face
    covered = inside(pins, collider, faces)
    σ[covered], face[covered] = _nearest_from_behind(collider, pins[covered], faces, face_normals(collider, faces))
    low = σ < clearance
    np.maximum.at(depth, faces[face[low]], (clearance - σ[low])[:, None])
    return depth


def _along(pins: Array, held_edges: Indices) -> Array:
    """Pins and points between them [P, 3]: collision is not asked of what is prescribed, so skin could come through an edge."""
    a, b = pins[held_edges[:, 0]], pins[held_edges[:, 1]]
    return np.concatenate([pins, *(a + share * (b - a) for share in BETWEEN)])


def _covered_depth(x: Array, faces: Indices, normals: Array, asked: Indices, clearance: float) -> tuple[Array, float]:
    """Depth [C] demanded of the asked vertices that lie inside another part, and the deepest penetration p [m] among them."""
    depth = np.zeros(len(x))
    under = asked[inside(x[asked] + 1e-4 * normals[asked], x, faces)] if len(asked) else asked
    p, cosine = _nearest_facing_away(x, under, normals, faces, face_normals(x, faces))
    met = np.isfinite(p)
    depth[under[met]] = p[met] / (1 - cosine[met]) + clearance
    return depth, float(p[met].max(initial=0.0))


def _gap_depth(x: Array, faces: Indices, e: Indices, normals: Array, asked: Indices, clearance: float) -> Array:
    """Depth [C] demanded of the asked vertices that face other skin, and of the ends of edges [E, 2] that face other edges."""
    depth, wanted = np.zeros(len(x)), 2 * clearance
    g = _gap(x, asked, normals, faces, face_normals(x, faces), wanted)
    depth[asked] = 0.5 * (wanted - np.minimum(g, wanted))
    _edges_apart(x, e[np.isin(e, asked).all(1)], normals, wanted, depth)
    return depth


def _ring_maximum(depth: Array, e: Indices) -> Array:
    """Each vertex takes half of the largest depth around it if that is more than its own, so that the drawn-in skin stays smooth."""
    out = depth.copy()
    if depth.any():
        for a, b in (e.T, e.T[::-1]):
            np.maximum.at(out, a, 0.5 * depth[b])
    return out


def _gap(x: Array, asked: Indices, normal: Array, faces: Indices, away: Array, reach: float) -> Array:
    """Distance [P] along asked vertices' normals to the first face that looks against them, infinite beyond reach."""
    centres = x[faces].mean(1)
    size = np.linalg.norm(x[faces] - centres[:, None], axis=2).max(initial=0.0)
    near = cKDTree(centres).query_ball_point(x[asked], reach + size)
    count = np.array([len(n) for n in near], np.int64)
    listed = np.concatenate([np.asarray(n, np.int64) for n in near]) if count.sum() else np.empty(0, np.int64)
    return _first_hit(x, asked, normal, faces, away, reach, listed, np.concatenate([[0], np.cumsum(count)]))


@njit(cache=True, nogil=True, error_model="numpy")
def _nearest_from_behind(x, points, faces, away):
    """σ = −distance [P] of points to the nearest face that they lie behind, and that face [P]: where parts meet, the nearest may be before them."""
    σ, face = np.full(len(points), -np.inf), np.zeros(len(points), np.int64)
    for i in range(len(points)):
        q = points[i]
        for f in range(len(faces)):
            a, b, c = faces[f]
            if np.sum(away[f] * (x[a] - q)) > 0:
                d = np.sqrt(np.sum((_closest(q, x[a], x[b], x[c]) - q) ** 2))
                if -d > σ[i]:
                    σ[i], face[i] = -d, f
    return σ, face


@njit(cache=True, nogil=True, error_model="numpy")
def _nearest_facing_away(x, asked, normal, faces, away):
    """Distance [P] from asked vertices to the nearest face that looks elsewhere (cosine < ½), infinite beyond 2·MOST, and that cosine [P]."""
    p, cosines = np.full(len(asked), np.inf), np.zeros(len(asked))
    centre, radius = np.zeros((len(faces), 3)), np.zeros(len(faces))
    for f in range(len(faces)):
        centre[f] = (x[faces[f, 0]] + x[faces[f, 1]] + x[faces[f, 2]]) / 3
        for v in faces[f]:
            radius[f] = max(radius[f], np.sqrt(np.sum((x[v] - centre[f]) ** 2)))
    whole = np.array([away[f].any() for f in range(len(faces))])  # a face without area looks nowhere
    squared, cosine = np.zeros(len(faces)), np.zeros(len(faces))
    for i in range(len(asked)):
        v = asked[i]
        bound = (2 * MOST) ** 2  # of the nearest face's squared distance: the centre of a face is on it
        for f in range(len(faces)):
            squared[f], cosine[f] = np.inf, 0.0
            for k in range(3):
                cosine[f] += away[f, k] * normal[v, k]
            if whole[f] and cosine[f] <= 0.5:
                squared[f] = (centre[f, 0] - x[v, 0]) ** 2 + (centre[f, 1] - x[v, 1]) ** 2 + (centre[f, 2] - x[v, 2]) ** 2
                bound = min(bound, squared[f])
        reach = np.sqrt(bound)
        for f in range(len(faces)):
            if squared[f] <= (min(p[i], reach) + radius[f]) ** 2:
                a, b, c = faces[f]
                d = np.sqrt(np.sum((_closest(x[v], x[a], x[b], x[c]) - x[v]) ** 2))
                if d < min(p[i], 2 * MOST):
                    p[i], cosines[i] = d, cosine[f]
    return p, cosines


@njit(cache=True, nogil=True, error_model="numpy")
def _closest(q, a, b, c):
    """The point of a triangle that is closest to q (Ericson 2005, §5.1.5)."""
    ab, ac = b - a, c - a
    d1, d2 = np.sum(ab * (q - a)), np.sum(ac * (q - a))
    if d1 <= 0 and d2 <= 0:
        return a
    d3, d4 = np.sum(ab * (q - b)), np.sum(ac * (q - b))
    if d3 >= 0 and d4 <= d3:
        return b
    d5, d6 = np.sum(ab * (q - c)), np.sum(ac * (q - c))
    if d6 >= 0 and d5 <= d6:
        return c
    opposite_c, opposite_b, opposite_a = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
    if opposite_c <= 0 and d1 >= 0 and d3 <= 0:
        return a + d1 / (d1 - d3) * ab
    if opposite_b <= 0 and d2 >= 0 and d6 <= 0:
        return a + d2 / (d2 - d6) * ac
    if opposite_a <= 0 and d4 >= d3 and d5 >= d6:
        return b + (d4 - d3) / (d4 - d3 + d5 - d6) * (c - b)
    return a + (ab * opposite_b + ac * opposite_c) / (opposite_a + opposite_b + opposite_c)


@njit(cache=True, nogil=True, error_model="numpy")
def _first_hit(x, asked, normal, faces, away, reach, listed, start):
    """Möller & Trumbore 1997 for the rays x + t·normal of asked vertices against their listed faces."""
    t = np.full(len(asked), np.inf)
    for i in range(len(asked)):
        v = asked[i]
        for f in listed[start[i] : start[i + 1]]:
            a, b, c = faces[f]
            cosine = away[f, 0] * normal[v, 0] + away[f, 1] * normal[v, 1] + away[f, 2] * normal[v, 2]
            if v not in (a, b, c) and cosine < FACING:
                hit = _ray_triangle(x[v], normal[v], x[a], x[b], x[c])
                if 0 <= hit < min(t[i], reach):
                    t[i] = hit
    return t


@njit(cache=True, nogil=True, error_model="numpy")
def _edges_apart(x, e, normal, wanted, depth):
    """Raise depth [C] at the ends of edges that face one another at a distance g < wanted; those whose boxes are near are found by a sweep along y."""
    low, high = np.minimum(x[e[:, 0]], x[e[:, 1]]), np.maximum(x[e[:, 0]], x[e[:, 1]]) + wanted
    order = np.argsort(low[:, 1])
    for i in range(len(order)):
        p = order[i]
        for q in order[i + 1 :]:
            if low[q, 1] > high[p, 1]:
                break
            if low[q, 0] > high[p, 0] or low[p, 0] > high[q, 0] or low[q, 2] > high[p, 2] or low[p, 2] > high[q, 2]:
                continue
            a, b, c, d = e[p, 0], e[p, 1], e[q, 0], e[q, 1]
            if a in (c, d) or b in (c, d):
                continue
            need = _edge_depth(x[a], x[b], x[c], x[d], normal[a] + normal[b], normal[c] + normal[d], wanted)
            for v in (a, b, c, d):
                depth[v] = max(depth[v], need)


@njit(cache=True, nogil=True, error_model="numpy")
def _edge_depth(a, b, c, d, n, m, wanted):
    """(wanted − g)/((n − m)·u) for edges ab and cd whose normals are along n and m, u from one to the other; 0 where they do not face one another."""
    u = np.array(between_segments((a[0], a[1], a[2]), (b[0], b[1], b[2]), (c[0], c[1], c[2]), (d[0], d[1], d[2])))
    g = np.sqrt(np.sum(u**2))
    if not 0 < g < wanted:
        return 0.0
    n, m = n / np.sqrt(np.sum(n**2)), m / np.sqrt(np.sum(m**2))
    opening = np.sum((n - m) * u) / g
    return (wanted - g) / opening if opening > 1 - FACING and np.sum(n * m) < FACING else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _ray_triangle(o, d, a, b, c):
    e1, e2 = b - a, c - a
    p = np.cross(d, e2)
    det = np.sum(e1 * p)
    if abs(det) < 1e-16:
        return -1.0
    s = o - a
    u = np.sum(s * p) / det
    q = np.cross(s, e1)
    v = np.sum(d * q) / det
    if u < 0 or v < 0 or u + v > 1:
        return -1.0
    return np.sum(e2 * q) / det
