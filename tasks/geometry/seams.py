"""Texture seams, cut: a copy of a welded mesh in which every vertex has one texture coordinate.

On the welded mesh a vertex on a texture seam has one place and several texture coordinates. File formats and renderers know only vertices
with everything attached, so there each pair (vertex, uv vertex) in use becomes a vertex of its own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Corners:
    """The same triangles with seams cut: vertex [K] and uv [K] say what each new vertex was made of; faces [F, 3] into K."""

    vertex: NDArray
    uv: NDArray
    faces: NDArray


def cut_seams(faces: NDArray, uv_faces: NDArray) -> Corners:
    """One corner per pair (vertex, uv vertex) that occurs in faces [F, 3] and uv_faces [F, 3]."""
    pairs = np.stack([faces.ravel(), uv_faces.ravel()], axis=1)
    unique, inverse = np.unique(pairs, axis=0, return_inverse=True)
    return Corners(unique[:, 0], unique[:, 1], inverse.reshape(faces.shape))
