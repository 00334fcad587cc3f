"""The rest shape: the sewing pattern where the texture atlas is one, else the first frame as worn.

An atlas whose charts are the garment's pattern at one scale maps every face almost isometrically: the singular values σ₁, σ₂ of the map
from the atlas to the first frame are then all near one common scale. Cloth is cut flat, so hinges of a pattern rest unfolded.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ISOMETRIC = 0.10  # 90th percentile of |log σ| about its median; worn cloth strains by a few percent, unwrapped meshes by tens


def pattern(x: Array, faces: NDArray[np.int32], uv_vertices: Array, uv_faces: NDArray[np.int32]) -> Array | None:
    """Flat rest coordinates [F, 3, 2] m of a garment x [V, 3] m from its atlas (uv_vertices [U, 2], uv_faces [F, 3]); None if that is no pattern."""
    if not len(uv_vertices):
        return None
    uv = uv_vertices[uv_faces]
    logs = np.log(np.maximum(_singular_values(x[faces], uv), 1e-12))
    scale = np.median(logs)
    if np.percentile(np.abs(logs - scale), 90) > ISOMETRIC:
        return None
    return uv * np.exp(scale)


def _singular_values(x: Array, uv: Array) -> Array:
    """Stretches [F, 2] of the maps from flat triangles uv [F, 3, 2] to x [F, 3, 3]."""
    D = np.stack([uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]], -1)
    d = np.stack([x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]], -1)
    flat = np.abs(np.linalg.det(D)) > 1e-14
    J = d[flat] @ np.linalg.inv(D[flat])
    return np.linalg.svd(J, compute_uv=False)
