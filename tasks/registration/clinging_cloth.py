"""Cloth that clings: where garments lie on the skin and stay on it, they show the body that they hide.

A waistband, a strap, a close-fitting top keep their height over the skin that they lay on in the first frame, whose body is known best; they
may slide along it. What clings is taken from that frame: borders that lie on the body all around (`LOOP`), and any cloth nearer than
`CLOSE`. Whether it still does is left to saturation (`LEAVES`): a skirt that swings is not to draw the body out.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.distances import closest_points
from tasks.geometry.meshes import boundary_edges, components
from tasks.registration.skin_distance import evenly, normals_at

Array = NDArray[np.float64]
Faces = NDArray[np.int32]

CLOSE = 0.006  # [m] from the skin: cloth of a close fit, its mesh and the body's being some millimetres off
LOOP = 0.03  # [m] that no vertex of a border may be off which is fastened: a waistband with what is worn under it
LEAVES = 0.01  # ρ [m]: what is further than that from where it clung has left


@dataclass(frozen=True)
class Clinging:
    """vertex [q] of the tracked surface; corners [q, 3] and barycentric [q, 3]: the point of the body under it; height [q] m over that."""

    vertex: NDArray[np.int64]
    corners: Faces
    barycentric: Array
    height: Array

    def at(self, surface: Array, seen: NDArray[np.bool_]) -> "Clinging":
        """Those of them that are tracked and seen in a frame, surface [V, 3] m, seen [V]."""
        own = seen[self.vertex] & np.isfinite(surface[self.vertex]).all(1)
        return Clinging(self.vertex[own], self.corners[own], self.barycentric[own], self.height[own])

    def skin(self, surface: Array, body: Array, faces: Faces) -> tuple[Array, Array]:
        """Where the skin under them is, by a frame's tracked surface [V, 3] m, and the normal [q, 3] of the body [B, 3] m there."""
        normal = normals_at(self.corners, self.barycentric, body, faces)
        return surface[self.vertex] - self.height[:, None] * normal, normal


NO_CLOTH = Clinging(np.zeros(0, np.int64), np.zeros((0, 3), np.int32), np.zeros((0, 3)), np.zeros(0))


def clinging(surface: Array, garment_faces: Faces, body: Array, faces: Faces) -> Clinging:
    """What clings to the body [B, 3] m in a frame; surface [V, 3] m, garment_faces [F, 3] of it."""
    cloth = np.unique(garment_faces)
    cloth = cloth[np.isfinite(surface[cloth]).all(1)]
    found = closest_points(surface[cloth], body, faces)
    off = np.full(len(surface), np.inf)
    off[cloth] = found.distance
    own = evenly(np.flatnonzero((found.distance < CLOSE) | np.isin(cloth, _fastened(garment_faces, off))))
    vertex, corners, barycentric = cloth[own], faces[found.face[own]], found.barycentric[own]
    height = np.sum((surface[vertex] - found.point[own]) * normals_at(corners, barycentric, body, faces), 1)
    return Clinging(vertex, corners, barycentric, height)


def _fastened(garment_faces: Faces, off: Array) -> NDArray[np.int64]:
    """Vertices of borders no vertex of which is further than `LOOP` off the body; off [V] m."""
    edge = boundary_edges(garment_faces)
    border = np.unique(edge)
    loop = components(edge[:, [0, 1, 1]], len(off))[border]  # an edge is a triangle of two corners
    farthest = np.zeros(len(off))
    np.maximum.at(farthest, loop, off[border])
    return border[farthest[loop] < LOOP]
