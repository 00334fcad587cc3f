"""Where the fitted body carries the skin of the template.

x_t = q_t + R_t R_0ᵀ (x_0 − q_0)

with q the point of the body's surface closest to x in frame 0, followed as a point of its face, and R the face's frame (first edge,
normal). In frame 0 this is the template itself, whatever the offset between body and skin. Cloth is not predicted (NaN): it goes on by
constant velocity.

Source: PhysAvatar §3.2 starts body vertices where the body model carries them (by the ten nearest body vertices; here by the closest
surface point).
Limits: what is further than a few centimetres from the body (hair, shoes, bags) is carried as if it were part of it.
"""

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.distances import closest_points

Array = NDArray[np.float64]


def carried_by_body(template: Array, carried: NDArray[np.bool_], body_vertices: Array, body_faces: NDArray[np.integer]) -> Array:
    """Predicted places [T, V, 3] m of the carried vertices [V] bool, NaN elsewhere;
    template [V, 3] m, body_vertices [T, B, 3] m, body_faces [G, 3].
    """
    predicted = np.full((len(body_vertices), len(template), 3), np.nan)
    if not carried.any():
        return predicted
    near = closest_points(template[carried], body_vertices[0], body_faces)
    corners = np.asarray(body_faces)[near.face]
    for t, body in enumerate(body_vertices):
        q, R = np.einsum("pc,pcx->px", near.barycentric, body[corners]), _frames(body[corners])
        if t == 0:
            offset = np.einsum("pxa,px->pa", R, template[carried] - q)
        predicted[t, carried] = q + np.einsum("pxa,pa->px", R, offset)
    return predicted


def _frames(corners: Array) -> Array:
    """Right-handed frames [P, 3, 3] of triangles [P, 3, 3], axes in columns: along the first edge, across, normal."""
    along = corners[:, 1] - corners[:, 0]
    normal = np.cross(along, corners[:, 2] - corners[:, 0])
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    return np.stack([along, np.cross(normal, along), normal], -1)
