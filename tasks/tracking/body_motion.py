"""Where the fitted body carries the skin of the template: linear blend skinning from frame 0 to frame t.

x_t = B_t B_0⁻¹ x_0,  B_t = Σ_j w_j T_tj

with joint weights w from the closest point of the body surface in frame 0. Cloth is not predicted (NaN): it goes on by constant velocity.

Source: PhysAvatar §3.2 initialises body vertices by skinning; the closest surface point replaces its ten nearest body vertices. Limits: skin
further than a few centimetres from the body (hair, shoes, bags) is carried as if it were part of it.
"""

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.distances import closest_points
from tasks.tracking.surface import SKIN

Array = NDArray[np.float64]


def skin_vertices(faces: NDArray[np.integer], part: NDArray[np.str_], vertex_count: int) -> NDArray[np.bool_]:
    """Vertices [V] all of whose faces are skin; part [F]."""
    skin, cloth = np.zeros(vertex_count, bool), np.zeros(vertex_count, bool)
    is_skin = np.asarray(part) == SKIN
    skin[faces[is_skin]], cloth[faces[~is_skin]] = True, True
    return skin & ~cloth


def carried_by_body(
    template: Array, carried: NDArray[np.bool_], body_vertices: Array, body_faces: NDArray[np.integer], *, weights: Array, transforms: Array
) -> Array:
    """Predicted places [T, V, 3] m of the carried vertices, NaN elsewhere.

    template [V, 3] m; carried [V] bool; body_vertices [B, 3] m in frame 0; body_faces [G, 3]; weights [B, J]; transforms [T, J, 4, 4] from the rest pose to each frame.
    """
    predicted = np.full((len(transforms), len(template), 3), np.nan)
    if not carried.any():
        return predicted
    near = closest_points(template[carried], body_vertices, body_faces)
    w = np.einsum("pc,pcj->pj", near.barycentric, weights[np.asarray(body_faces)[near.face]])
    blended = np.einsum("pj,tjab->tpab", w / w.sum(1, keepdims=True), transforms)
    rest = np.linalg.solve(blended[0], np.concatenate([template[carried], np.ones((len(w), 1))], 1)[..., None])
    predicted[:, carried] = (blended @ rest)[..., :3, 0]
    return predicted
