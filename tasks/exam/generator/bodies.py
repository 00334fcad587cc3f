"""Bodies as formulas: capsules on moving bones, with exact distance; meshes of them are what a diagnosis is given.

A capsule with equal ends is a sphere. Every capsule belongs to a bone; a bone's pose at time t is a rotation and a translation.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tasks.geometry.simplex_distances import along, dot, length, minus, row

Array = NDArray[np.float64]
Faces = NDArray[np.int32]
Pose = Callable[[float], tuple[Array, Array]]  # t [s] -> rotations [bone, 3, 3], translations [bone, 3] m
RING, CAP = 20, 5  # vertices around a capsule's mesh, rings in each of its caps
TICK = 1e-4  # s, to differentiate poses


@dataclass(frozen=True)
class Body:
    """Capsules: ends a, b [K, 3] m at rest, radius [K] m, bone [K]."""

    a: Array
    b: Array
    radius: Array
    bone: NDArray[np.int32]

    def placed(self, pose: Pose, t: float) -> "Placed":
        """The capsules at time t and how they move."""
        (R0, p0), (R1, p1) = pose(t - TICK), pose(t + TICK)
        R, p = pose(t)

        def ends(R: Array, p: Array, x: Array) -> Array:
            return np.einsum("kij,kj->ki", R[self.bone], x) + p[self.bone]

        va = (ends(R1, p1, self.a) - ends(R0, p0, self.a)) / (2 * TICK)
        dR = (R1 - R0) / (2 * TICK) @ R.transpose(0, 2, 1)
        ω = np.stack([dR[:, 2, 1], dR[:, 0, 2], dR[:, 1, 0]], 1)[self.bone]
        return Placed(ends(R, p, self.a), ends(R, p, self.b), self.radius, va, ω)

    def mesh(self, pose: Pose, times: Array) -> tuple[Array, Faces]:
        """Vertices [T, C, 3] and faces [G, 3]: closed pieces, one per capsule, that may reach into one another."""
        pieces, faces, count, bone = [], [], 0, []
        for a, b, r, k in zip(self.a, self.b, self.radius, self.bone, strict=True):
            x, f = _capsule_mesh(a, b, r)
            pieces.append(x)
            faces.append(f + count)
            bone.append(np.full(len(x), k))
            count += len(x)
        rest, bones = np.concatenate(pieces), np.concatenate(bone)
        poses = [pose(t) for t in times]
        moved = [np.einsum("cij,cj->ci", R[bones], rest) + p[bones] for R, p in poses]
        return np.stack(moved), np.concatenate(faces).astype(np.int32)


@dataclass(frozen=True)
class Placed:
    """Capsules at one moment: ends a, b [K, 3], radius [K], velocity of a's material va [K, 3] m/s, spin ω [K, 3] 1/s."""

    a: Array
    b: Array
    radius: Array
    va: Array
    ω: Array

    def distance(self, x: Array) -> tuple[Array, Array]:
        """Distance [K, V] m of points x [V, 3] to each capsule and its gradient [K, V, 3]."""
        return _distance(x, self.a, self.b, self.radius)


@njit(cache=True, nogil=True)
def _distance(x, a, b, radius):
    K, V = len(a), len(x)
    d, n = np.empty((K, V)), np.empty((K, V, 3))
    for k in range(K):
        start = row(a, k)
        e = minus(row(b, k), start)
        ee = max(dot(e, e), 1e-20)
        for i in range(V):
            r = minus(row(x, i), start)
            q = along(r, -min(max(dot(r, e) / ee, 0.0), 1.0), e)
            away = max(length(q), 1e-12)
            d[k, i] = away - radius[k]
            n[k, i, 0], n[k, i, 1], n[k, i, 2] = q[0] / away, q[1] / away, q[2] / away
    return d, n


def _capsule_mesh(a: Array, b: Array, radius: float) -> tuple[Array, Faces]:
    """A closed triangle mesh whose mean distance from the capsule is about nil: vertices lie a little outside."""
    axis = b - a
    length = np.linalg.norm(axis)
    w = axis / length if length > 1e-9 else np.array([0.0, 1.0, 0.0])
    u = np.cross(w, [1.0, 0, 0] if abs(w[0]) < 0.7 else [0, 0, 1.0])
    u /= np.linalg.norm(u)
    v = np.cross(w, u)
    polar = np.pi / 2 * np.arange(1, CAP + 1) / CAP
    rows = [(a, -np.cos(p), np.sin(p)) for p in polar[:-1]] + _barrel(a, b, radius) + [(b, np.cos(p), np.sin(p)) for p in polar[-2::-1]]
    r = radius * (1 + np.pi**2 / (3 * RING**2) / 2)
    rings = []
    for i, (centre, z, ρ) in enumerate(rows):
        angle = 2 * np.pi * (np.arange(RING) + 0.5 * (i % 2)) / RING
        rings.append(centre + r * (z * w + ρ * (np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v)))
    x = np.concatenate([[a - r * w], *rings, [b + r * w]])
    faces, last = [], len(x) - 1
    for j in range(RING):
        k = (j + 1) % RING
        faces.append((0, 1 + k, 1 + j))
        for i in range(len(rows) - 1):
            p, q = 1 + i * RING, 1 + (i + 1) * RING
            if i % 2 == 0:
                faces += [(p + j, p + k, q + j), (p + k, q + k, q + j)]
            else:
                faces += [(p + j, q + k, q + j), (p + j, p + k, q + k)]
        p = 1 + (len(rows) - 1) * RING
        faces.append((last, p + j, p + k))
    return x, np.array(faces, np.int32)


def _barrel(a: Array, b: Array, radius: float) -> list[tuple[Array, float, float]]:
    """Rings of the straight part, as far apart as the vertices in a ring."""
    n = max(1, round(np.linalg.norm(b - a) / (2 * np.pi * radius / RING)))
    if np.linalg.norm(b - a) < 1e-9:
        return [(a, 0.0, 1.0)]
    return [(a + (b - a) * i / n, 0.0, 1.0) for i in range(n + 1)]
