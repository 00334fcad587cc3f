"""Where a collider gives way: skin that meets skin would pinch cloth into nothing, and skin in front of a pinned node cannot be obeyed.

Three demands, each a depth [m] by which collider vertices are drawn in along their normals (c: clearance, two barrier distances and
the offset):

    penetration   skin inside another part of the collider, by p                       ½ p + c
    narrow gap    skin that faces other skin at a distance g < 2c                      ½ (2c − g)
    pins          a prescribed cloth node at signed distance σ < c, near its foot      c − σ

p is the distance to the nearest skin that looks elsewhere, g that along the normal; inside by the generalised winding number (Jacobson
et al. 2013). As normals are not the shortest way out, the drawn-in skin is examined again, eight times at most.
Only skin within 12 cm of the cloth gives way: mouths and fingers do not matter. Limits: no deeper than 0.1 m.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tasks.geometry.distances import closest_points, inside, signed_distance
from tasks.geometry.meshes import edges, face_normals, vertex_normals

Array = NDArray[np.float64]
Indices = NDArray[np.int32]
REACH = 0.12  # [m], more than the deepest skin can lie behind cloth
MOST = 0.1  # [m]
PASSES = 8


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


def give_way(collider: Array, faces: Indices, *, cloth: Array, pins: Array, clearance: float) -> tuple[Array, Yielded]:
    """The collider [C, 3] drawn in where it pinches itself near cloth [V, 3] or covers pins [B, 3]; faces [F, 3], clearance c [m]."""
    if not len(faces):
        return collider, Yielded(np.zeros(len(collider)))
    normals, e = vertex_normals(collider, faces), edges(faces)
    near = cKDTree(cloth).query(collider, distance_upper_bound=REACH)[0] < REACH
    depth = _ring_maximum(pin_depth(collider, faces, pins, clearance), e)
    for _ in range(PASSES):
        more = pinch_depth(draw_in(collider, normals, depth), faces, normals, np.flatnonzero(near), clearance)
        if not more.any():
            break
        depth = np.minimum(depth + _ring_maximum(more, e), MOST)
    return draw_in(collider, normals, depth), Yielded(depth)


def draw_in(collider: Array, normals: Array, depth: Array) -> Array:
    """Collider vertices moved inward along their normals by depth [C] m."""
    return collider - depth[:, None] * normals


def pinch_depth(collider: Array, faces: Indices, normals: Array, asked: Indices, clearance: float) -> Array:
    """Depth [C] demanded of the asked vertices because skin meets skin."""
    depth = np.zeros(len(collider))
    if not len(asked):
        return depth
    covered = inside(collider[asked] + 1e-4 * normals[asked], collider, faces)
    away = face_normals(collider, faces)
    under, over = asked[covered], asked[~covered]
    p = _nearest_facing_away(collider, under, normals, faces, away)
    depth[under] = np.where(np.isfinite(p), 0.5 * p + clearance, 0.0)
    depth[over] = 0.5 * (2 * clearance - np.minimum(_gap(collider, over, normals, faces, away, 2 * clearance), 2 * clearance))
    return depth


def pin_depth(collider: Array, faces: Indices, pins: Array, clearance: float) -> Array:
    """Depth [C] demanded by pinned nodes [B, 3] that lie under the skin or on it."""
    depth = np.zeros(len(collider))
    if not len(pins):
        return depth
    σ = signed_distance(pins, collider, faces)
    for i in np.flatnonzero(σ < clearance):
        foot = closest_points(pins[i : i + 1], collider, faces)
        corners = faces[foot.face[0]]
        depth[corners] = np.maximum(depth[corners], clearance - σ[i])
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


@njit(cache=True, nogil=True)
def _nearest_facing_away(x, asked, normal, faces, away):
    """Distance [P] from asked vertices to the centre of the nearest face that looks elsewhere (cosine < ½), infinite beyond 2·MOST."""
    p = np.full(len(asked), np.inf)
    for i in range(len(asked)):
        v = asked[i]
        for f in range(len(faces)):
            squared, cosine = 0.0, 0.0
            for k in range(3):
                squared += ((x[faces[f, 0], k] + x[faces[f, 1], k] + x[faces[f, 2], k]) / 3 - x[v, k]) ** 2
                cosine += away[f, k] * normal[v, k]
            if cosine <= 0.5 and squared < min(p[i], 2 * MOST) ** 2:
                p[i] = np.sqrt(squared)
    return p


@njit(cache=True, nogil=True)
def _first_hit(x, asked, normal, faces, away, reach, listed, start):
    """Möller & Trumbore 1997 for the rays x + t·normal of asked vertices against their listed faces."""
    t = np.full(len(asked), np.inf)
    for i in range(len(asked)):
        v = asked[i]
        for f in listed[start[i] : start[i + 1]]:
            a, b, c = faces[f]
            cosine = away[f, 0] * normal[v, 0] + away[f, 1] * normal[v, 1] + away[f, 2] * normal[v, 2]
            if v not in (a, b, c) and cosine < -0.2:
                hit = _ray_triangle(x[v], normal[v], x[a], x[b], x[c])
                if 0 <= hit < min(t[i], reach):
                    t[i] = hit
    return t


@njit(cache=True, nogil=True)
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
