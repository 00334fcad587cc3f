"""Closest points on a triangle surface and signed distance, by libigl's bounding-box hierarchy."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.faults import Fault, refuse

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Closest:
    """The nearest surface point of each query: point [P, 3] m, face [P], barycentric [P, 3], distance [P] m."""

    point: Array
    face: NDArray[np.int64]
    barycentric: Array
    distance: Array


def closest_points(points: Array, vertices: Array, faces: NDArray[np.int32]) -> Closest:
    """Closest points on the surface (vertices [V, 3], faces [F, 3]) to points [P, 3]. Raises BadInput for a surface without faces, with which
    libigl would end the process.
    """
    import igl

    refuse([] if len(faces) else [Fault("surface", "it has no face, so no point of it is closest", "Give a triangle mesh.")])
    p, V, F = (np.ascontiguousarray(points, float), np.ascontiguousarray(vertices, float), np.ascontiguousarray(faces, np.int64))
    d2, face, q = igl.point_mesh_squared_distance(p, V, F)
    face = np.asarray(face).ravel()
    return Closest(q, face, barycentric_coordinates(q, V[F[face]]), np.sqrt(np.asarray(d2).ravel()))


def barycentric_coordinates(points: Array, corners: Array) -> Array:
    """Barycentric coordinates [P, 3] of points [P, 3] in the planes of triangles [P, 3, 3] (Ericson 2005, §3.4), clipped to the triangle."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    e1, e2, r = b - a, c - a, points - a
    d11, d12, d22 = (np.sum(u * v, 1) for u, v in ((e1, e1), (e1, e2), (e2, e2)))
    r1, r2 = np.sum(r * e1, 1), np.sum(r * e2, 1)
    det = np.maximum(d11 * d22 - d12 * d12, 1e-300)
    β, γ = (d22 * r1 - d12 * r2) / det, (d11 * r2 - d12 * r1) / det
    w = np.clip(np.stack([1 - β - γ, β, γ], 1), 0, None)
    return w / w.sum(1, keepdims=True)


def signed_distance(points: Array, vertices: Array, faces: NDArray[np.int32]) -> Array:
    """Distance [P] m, negative inside."""
    return np.where(inside(points, vertices, faces), -1.0, 1.0) * closest_points(points, vertices, faces).distance


def inside(points: Array, vertices: Array, faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Whether points [P, 3] lie inside, by the generalised winding number (Jacobson et al. 2013), so small holes do not matter."""
    import igl

    V, F = np.ascontiguousarray(vertices, float), np.ascontiguousarray(faces, np.int64)
    return np.asarray(igl.fast_winding_number(V, F, np.ascontiguousarray(points, float))).ravel() > 0.5
