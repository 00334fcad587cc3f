"""How numbers on stencils (an angle per hinge, a strain per face) move with the vertices, and forces come back from them."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from tasks.simulator.potential import Array


def lever(stencils: NDArray[np.int32], slopes: Array, vertex_count: int) -> csc_matrix:
    """∂q/∂x transposed [3V, K] of quantities q [K], from their slopes [K, m, 3] at the vertices of stencils [K, m]."""
    K, m = stencils.shape
    rows = 3 * stencils[:, :, None] + np.arange(3, dtype=np.int32)
    return csc_matrix((slopes.ravel(), rows.ravel(), 3 * m * np.arange(K + 1)), shape=(3 * vertex_count, K))


def rates(lever: csc_matrix, dx: Array) -> Array:
    """dq [P, K] for dx [P, V, 3]."""
    return (lever.T @ dx.reshape(len(dx), -1).T).T


def forces(lever: csc_matrix, moments: Array) -> Array:
    """Σ_k moment_k ∂q_k/∂x: [V, 3] for moments [K], [P, V, 3] for moments [P, K]."""
    return (lever @ moments.T).T.reshape(*moments.shape[:-1], -1, 3)


def strain_slopes(x: Array, faces: NDArray[np.int32], N: Array) -> Array:
    """∂(E₁₁, E₂₂, 2E₁₂)/∂x of each face [F, 3, 3 corners, 3 axes], for its shape gradients N [F, 3, 2]."""
    f = np.einsum("fpi,fpa->fai", x[faces], N)  # the columns of the deformation gradient
    one, two = N[:, :, :1], N[:, :, 1:]
    f1, f2 = f[:, :1], f[:, 1:]
    return np.stack([one * f1, two * f2, two * f1 + one * f2], 1)
