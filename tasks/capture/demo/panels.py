"""Flat panels of cloth cut into well-shaped, unstructured triangles.

Points start on a jittered hexagonal grid and repel each other as springs that only push (Persson & Strang 2004, *A Simple Mesh
Generator in MATLAB*, eq. 3-4) between Delaunay re-triangulations. The outline is never moved: seams of two panels match point by point.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Faces = NDArray[np.int32]

PUSH = 1.2  # rest length of the springs over the spacing; > 1 lets the points fill the panel
SWEEPS = 40


def sample(curve: Array, spacing: float) -> Array:
    """A polyline [P, 2 or 3] m resampled at equal steps as near to `spacing` as fits, ends kept."""
    s = np.r_[0, np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))]
    count = max(1, round(s[-1] / spacing))
    at = np.linspace(0, s[-1], count + 1)
    return np.stack([np.interp(at, s, column) for column in curve.T], 1)


def triangulate(outline: Array, spacing: float, rng: np.random.Generator) -> tuple[Array, Faces]:
    """Points [P, 2] m, outline first, and counter-clockwise faces [F, 3] that fill the simple polygon outline [B, 2] m.

    Raises ValueError where the outline is so coarse or narrow that one of its edges is not an edge of the triangulation.
    """
    interior = _grid(outline, spacing, rng)
    for _ in range(SWEEPS):
        points = np.concatenate([outline, interior])
        interior = interior + 0.2 * _pushes(points, _delaunay(points, outline), spacing)[len(outline) :]
        interior = interior[inside(interior, outline)]
    points = np.concatenate([outline, interior])
    faces = _delaunay(points, outline)
    _require_outline(faces, len(outline))
    return points, faces


def inside(points: Array, outline: Array) -> NDArray[np.bool_]:
    """Whether points [P, 2] lie in the polygon [B, 2], by the parity of crossings with a ray along +x."""
    a, b = outline, np.roll(outline, -1, 0)
    y = points[:, 1, None]
    crosses = (a[:, 1] > y) != (b[:, 1] > y)
    rise = np.where(b[:, 1] == a[:, 1], 1.0, b[:, 1] - a[:, 1])
    return ((crosses & (points[:, 0, None] < a[:, 0] + (y - a[:, 1]) / rise * (b[:, 0] - a[:, 0]))).sum(1) % 2).astype(bool)


def _grid(outline: Array, spacing: float, rng: np.random.Generator) -> Array:
    from scipy.spatial import cKDTree

    low, high = outline.min(0), outline.max(0)
    u, v = np.meshgrid(np.arange(low[0], high[0], spacing), np.arange(low[1], high[1], spacing * np.sqrt(3) / 2))
    u = u + spacing / 2 * (np.arange(len(u)) % 2)[:, None]
    points = np.stack([u.ravel(), v.ravel()], 1)
    points = points + rng.uniform(-0.2, 0.2, points.shape) * spacing
    points = points[inside(points, outline)]
    return points[cKDTree(outline).query(points)[0] > 0.62 * spacing]


def _delaunay(points: Array, outline: Array) -> Faces:
    from scipy.spatial import Delaunay

    faces = Delaunay(points).simplices  # counter-clockwise in the plane, by scipy's promise
    a, b, c = points[faces].transpose(1, 0, 2)
    area = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    return faces[inside((a + b + c) / 3, outline) & (area > 1e-12)].astype(np.int32)


def _pushes(points: Array, faces: Faces, spacing: float) -> Array:
    half = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    a, b = np.unique(np.sort(half, axis=1), axis=0).T
    along = points[a] - points[b]
    length = np.linalg.norm(along, axis=1)
    push = np.maximum(PUSH * spacing - length, 0)[:, None] * along / length[:, None]
    total = np.zeros_like(points)
    np.add.at(total, a, push)
    np.add.at(total, b, -push)
    return total


def _require_outline(faces: Faces, count: int) -> None:
    have = {tuple(e) for f in faces.tolist() for e in ((f[0], f[1]), (f[1], f[2]), (f[2], f[0]))}
    missing = [i for i in range(count) if (i, (i + 1) % count) not in have]
    if missing:
        raise ValueError(f"outline edges {missing[:5]} are not edges of the triangulation; use a finer spacing")
