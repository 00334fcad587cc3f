"""Smooth modes of the cloth: what a start state may be wrong by.

Lowest eigenvectors of the cotangent Laplacian of the rest shape with zero at the prescribed nodes, times three directions, for place and
velocity each: L φ = λ M φ, scaled to a root mean square of 1 over the cloth.

Source: Laplace–Beltrami eigenfunctions as in Reuter et al. 2006; their use for state error follows reduced-rank assimilation (Cane et al.
1996).
"""

import igl
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix, diags
from scipy.sparse.linalg import eigsh

from tasks.simulator import Cloth

Array = NDArray[np.float64]


def smooth_modes(cloth: Cloth, count: int) -> Array:
    """φ [count, V], lowest first; fewer where the cloth has fewer free vertices."""
    V = len(cloth.x_rest)
    free = np.setdiff1d(np.arange(V), cloth.boundary)
    count = min(count, len(free) - 2)
    L = csc_matrix(-igl.cotmatrix(np.asfortranarray(cloth.x_rest), np.asfortranarray(cloth.faces.astype(np.int64))))[free][:, free]
    area = cloth.vertex_areas[free]
    start = np.ones(len(free))  # the same input gives the same modes
    _, φ = eigsh(L, k=count, M=diags(area).tocsc(), sigma=-1e-3, v0=start)
    out = np.zeros((count, V))
    out[:, free] = φ.T * np.sqrt(cloth.vertex_areas.sum())
    return out


def state_columns(φ: Array) -> dict[str, tuple[Array, Array]]:
    """name -> (∂x0, ∂v0) [V, 3] of every mode [K, V] in every direction: "x 0 y" is the first mode's displacement along y."""
    columns = {}
    for k, mode in enumerate(φ):
        for c, axis in enumerate("xyz"):
            d = np.zeros((len(mode), 3))
            d[:, c] = mode
            columns[f"x {k} {axis}"] = (d, np.zeros_like(d))
            columns[f"v {k} {axis}"] = (np.zeros_like(d), d)
    return columns
