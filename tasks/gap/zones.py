"""Zones of a garment: where a gap can live. Pinned before contact, seam and hem, and free for the rest.

pinned   driven boundary nodes
contact  nearer to the body than CONTACT_M in more than half of the frames
seam     on an interior edge where the pattern is cut (two UV coordinates meet)
hem      on an open border of the garment
"""

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.meshes import boundary_edges

ZONES = ("free", "hem", "seam", "contact", "pinned")
CONTACT_M = 0.008  # [m] twice the typical tracking error of skin and cloth together


def zones(
    faces: NDArray[np.int32], uv_faces: NDArray[np.int32] | None, body_distance: NDArray[np.float64], pinned: NDArray[np.bool_]
) -> NDArray[np.int32]:
    """Index into `ZONES` of every vertex [V]; faces, uv_faces [F, 3], body_distance [T, V] m (inf where unknown), pinned [V]."""
    zone = np.zeros(len(pinned), np.int32)
    hem = np.unique(boundary_edges(faces))
    zone[hem] = ZONES.index("hem")
    if uv_faces is not None:
        zone[_seam(faces, uv_faces)] = ZONES.index("seam")
    zone[(body_distance < CONTACT_M).mean(0) > 0.5] = ZONES.index("contact")
    zone[pinned] = ZONES.index("pinned")
    return zone


def _seam(faces: NDArray[np.int32], uv_faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """Vertices that have more than one place in the pattern."""
    pairs = np.unique(np.stack([faces.ravel(), uv_faces.ravel()], 1), axis=0)
    vertex, count = np.unique(pairs[:, 0], return_counts=True)
    return vertex[count > 1].astype(np.int32)
