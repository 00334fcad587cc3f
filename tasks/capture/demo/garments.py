"""A garment sewn from flat panels: welded in space, apart in the pattern.

`vertices`, `faces` are the surface as sewn; `uv_vertices` [m] (u weft, v warp) and `uv_faces` the pattern, in which every panel lies by
itself. A second mesh of the same pattern finds its place on the first one through the pattern (`Sampling`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.distances import closest_points
from tasks.geometry.meshes import weld

Array = NDArray[np.float64]
Faces = NDArray[np.int32]

PANEL_GAP = 0.03  # [m] between panels in the pattern
SEWN = 1e-6  # [m] panels meet by construction, up to rounding


@dataclass(frozen=True)
class Panel:
    """points [P, 2] m of the pattern, faces [F, 3], place [P, 3] m on the body, held [P] bool: carried by the body."""

    points: Array
    faces: Faces
    place: Array
    held: NDArray[np.bool_]


@dataclass(frozen=True)
class Garment:
    """vertices [V, 3] m as sewn, faces [F, 3], uv_vertices [U, 2] m, uv_faces [F, 3], boundary [B] vertices that the body carries."""

    name: str
    vertices: Array
    faces: Faces
    uv_vertices: Array
    uv_faces: Faces
    boundary: NDArray[np.int32]


@dataclass(frozen=True)
class Sampling:
    """Points on a surface: corners [P, 3] vertex indices, weights [P, 3] summing to 1."""

    corners: Faces
    weights: Array

    def of(self, vertices: Array) -> Array:
        """The points [..., P, 3] on the surface with vertices [..., V, 3]."""
        return np.einsum("pk,...pkd->...pd", self.weights, vertices[..., self.corners, :])


def sew(name: str, panels: Sequence[Panel]) -> Garment:
    """Weld panels where their places on the body meet; in the pattern they are laid side by side along u."""
    laid, at = [], 0.0
    for panel in panels:
        shift = np.array([at - panel.points[:, 0].min(), -panel.points[:, 1].min()])
        laid.append(panel.points + shift)
        at = laid[-1][:, 0].max() + PANEL_GAP
    starts = np.cumsum([0] + [len(panel.points) for panel in panels])
    uv_faces = np.concatenate([panel.faces + start for panel, start in zip(panels, starts)]).astype(np.int32)
    vertices, index = weld(np.concatenate([panel.place for panel in panels]), SEWN)
    boundary = np.unique(index[np.concatenate([panel.held for panel in panels])])
    return Garment(name, vertices, index[uv_faces], np.concatenate(laid), uv_faces, boundary.astype(np.int32))


def locate(coarse: Garment, fine: Garment) -> Sampling:
    """Where the vertices of one mesh of a pattern lie on another mesh of it; outlines that differ by a chord go to the nearest point."""
    flat = np.c_[fine.uv_vertices, np.zeros(len(fine.uv_vertices))]
    first = np.full(len(coarse.vertices), -1)
    first[coarse.faces.ravel()[::-1]] = coarse.uv_faces.ravel()[::-1]  # any one of a seam vertex's places in the pattern will do
    found = closest_points(np.c_[coarse.uv_vertices[first], np.zeros(len(first))], flat, fine.uv_faces)
    return Sampling(fine.faces[found.face], found.barycentric)


def pattern_strain(garment: Garment) -> Array:
    """Principal stretches [F, 2] of the sewn surface against the pattern: 1 where the garment was sewn without stretching."""
    E3 = _edge_pairs(garment.vertices, garment.faces)
    E2 = _edge_pairs(garment.uv_vertices, garment.uv_faces)
    return np.linalg.svd(E3 @ np.linalg.inv(E2), compute_uv=False)


def _edge_pairs(vertices: Array, faces: Faces) -> Array:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.stack([b - a, c - a], -1)
