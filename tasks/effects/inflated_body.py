"""A body that is larger than recorded, by the same distance along all its normals."""

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.meshes import vertex_normals
from tasks.simulator.potential import Array


def inflated(body: Array, faces: NDArray[np.int32], distance: float) -> Array:
    """body [T, C, 3] m moved outwards along its vertex normals by `distance` [m]."""
    if not distance or not len(faces):
        return body
    return body + distance * np.stack([vertex_normals(x, faces) for x in body])
