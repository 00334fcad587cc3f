"""Unstructured triangle meshes of flat patterns: relaxed random points and their Delaunay triangulation (Persson & Strang 2004, in spirit).

A pattern is a rectangle or a sector of an annulus. Its two straight sides may be sewn together: they then carry the same points.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, cKDTree

Array = NDArray[np.float64]
Faces = NDArray[np.int32]
RELAXATIONS = 8


@dataclass(frozen=True)
class Pattern:
    """Polar rectangle: radius in [inner, outer] m, angle in [0, opening] rad; a plain rectangle where inner is infinite: width × height m.

    sewn: whether the sides at angle 0 and `opening` are one line.
    """

    width: float
    height: float
    inner: float = np.inf
    sewn: bool = False

    @property
    def opening(self) -> float:
        """Angle of the sector [rad]; `width` is the length of its inner arc."""
        return self.width / self.inner

    def place(self, s: Array, t: Array) -> Array:
        """Points [P, 2] m of the flat pattern; s in [0, 1] along the inner edge, t in [0, 1] from the inner to the outer edge."""
        if np.isinf(self.inner):
            return np.stack([s * self.width, t * self.height], -1)
        r, angle = self.inner + t * self.height, s * self.opening
        return np.stack([r * np.cos(angle), r * np.sin(angle)], -1)

    def coordinates(self, p: Array) -> tuple[Array, Array]:
        """s, t of points [P, 2] of the pattern."""
        if np.isinf(self.inner):
            return p[:, 0] / self.width, p[:, 1] / self.height
        return np.arctan2(p[:, 1], p[:, 0]) % (2 * np.pi) / self.opening, (np.hypot(p[:, 0], p[:, 1]) - self.inner) / self.height

    def arc(self, t: float) -> float:
        """Length of the line of constant t [m]."""
        return self.width if np.isinf(self.inner) else self.width * (1 + t * self.height / self.inner)

    @property
    def area(self) -> float:
        """Area [m²]."""
        return self.height * (self.arc(0.0) + self.arc(1.0)) / 2


@dataclass(frozen=True)
class FlatMesh:
    """Points of a pattern (s, t) [P], faces [F, 3] over them, and for each point the vertex [P] that it is once sides are sewn."""

    s: Array
    t: Array
    faces: Faces
    vertex: NDArray[np.int32]


def flat_mesh(pattern: Pattern, vertex_count: int, rng: np.random.Generator) -> FlatMesh:
    """About `vertex_count` vertices, evenly spread, no two rows alike."""
    edge = np.sqrt(2 / np.sqrt(3) * pattern.area / vertex_count)
    border, sides = _border(pattern, edge)
    inside = _scattered(pattern, edge, rng)
    inside = inside[cKDTree(border).query(inside)[0] > 0.55 * edge]
    for _ in range(RELAXATIONS):
        inside = _relaxed(pattern, border, inside)
    points = np.concatenate([border, inside])
    faces = _triangles(pattern, points)
    s, t = pattern.coordinates(points)
    s[sides[:, 0]], s[sides[:, 1]] = 0.0, 1.0
    vertex = np.arange(len(points), dtype=np.int32)
    if pattern.sewn:
        vertex[sides[:, 1]] = sides[:, 0]
        vertex = np.unique(vertex, return_inverse=True)[1].astype(np.int32)
    return FlatMesh(s, np.clip(t, 0, 1), faces, vertex)


def locate(pattern: Pattern, mesh: FlatMesh, s: Array, t: Array) -> tuple[NDArray[np.int32], Array]:
    """Face [P] of a mesh of the pattern and barycentric coordinates [P, 3] in it of the points s, t [P]; outside the nearest face serves."""
    corners = pattern.place(mesh.s, mesh.t)[mesh.faces]
    a, e1, e2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    det = e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]
    r = pattern.place(s, t)[:, None] - a
    β = (r[..., 0] * e2[:, 1] - r[..., 1] * e2[:, 0]) / det
    γ = (e1[:, 0] * r[..., 1] - e1[:, 1] * r[..., 0]) / det
    w = np.stack([1 - β - γ, β, γ], -1)
    face = w.min(-1).argmax(1)
    w = np.clip(w[np.arange(len(s)), face], 0, None)
    return face.astype(np.int32), w / w.sum(1, keepdims=True)


def _border(pattern: Pattern, edge: float) -> tuple[Array, NDArray[np.int32]]:
    """Points around the pattern, and the pairs [K, 2] of them that lie opposite on the two straight sides."""
    across = max(3, round(pattern.height / edge))
    t = np.linspace(0, 1, across + 1)
    sides = [pattern.place(np.zeros_like(t), t), pattern.place(np.ones_like(t), t)]
    arcs = []
    for end in (0.0, 1.0):
        n = max(4, round(pattern.arc(end) / edge))
        s = np.linspace(0, 1, n + 1)[1:-1]
        arcs.append(pattern.place(s, np.full_like(s, end)))
    k = np.arange(across + 1)
    return np.concatenate([*sides, *arcs]), np.stack([k, k + across + 1], 1)


def _scattered(pattern: Pattern, edge: float, rng: np.random.Generator) -> Array:
    """A hexagonal lattice at a random angle, shaken."""
    reach = 2 * (pattern.height + (pattern.width if np.isinf(pattern.inner) else pattern.inner))
    n = int(reach / edge) + 2
    i, j = np.meshgrid(np.arange(-n, n), np.arange(-n, n))
    lattice = edge * np.stack([i + 0.5 * j, np.sqrt(3) / 2 * j], -1).reshape(-1, 2)
    angle = rng.uniform(0, np.pi / 3)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    p = lattice @ turn.T + rng.normal(0, 0.15 * edge, lattice.shape)
    return p[_inside(pattern, p)]


def _inside(pattern: Pattern, p: Array) -> NDArray[np.bool_]:
    s, t = pattern.coordinates(p)
    return (s > 0) & (s < 1) & (t > 0) & (t < 1)


def _relaxed(pattern: Pattern, border: Array, inside: Array) -> Array:
    """Every inner point in the middle of its neighbours."""
    points = np.concatenate([border, inside])
    faces = _triangles(pattern, points)
    i, j = faces[:, [0, 1, 2, 1, 2, 0]].ravel(), faces[:, [1, 2, 0, 0, 1, 2]].ravel()
    total, count = np.zeros_like(points), np.zeros(len(points))
    np.add.at(total, i, points[j])
    np.add.at(count, i, 1)
    moved = total[len(border) :] / np.maximum(count[len(border) :, None], 1)
    return np.where(_inside(pattern, moved)[:, None], moved, inside)


def _triangles(pattern: Pattern, points: Array) -> Faces:
    """Delaunay triangles that lie in the pattern, counter-clockwise."""
    faces = Delaunay(points).simplices
    a, b, c = (points[faces[:, k]] for k in range(3))
    area = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    faces[area < 0] = faces[area < 0][:, [0, 2, 1]]
    kept = _inside(pattern, (a + b + c) / 3) & (np.abs(area) > 1e-4 * pattern.area / len(points))
    return faces[kept].astype(np.int32)
