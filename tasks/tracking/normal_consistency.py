"""Neighbouring faces look the same way.

P(x) = ½ Σ_h |n₁ − n₂ − m_h|²/σ²

with n₁, n₂ the unit normals on both sides of hinge h = (a, b, c, d). m_h = 0 for cloth, which pulls towards flat (|n₁ − n₂|²/2 = 1 − n₁·n₂,
the normal loss of PhysAvatar §3.2); for skin, whose shape the fitted body predicts, m_h is the predicted difference.

Both normals are differentiated exactly: n = N/|N|, N = (x₁ − x₀) × (x₂ − x₀), ∂N/∂x_i = [x_{i+2} − x_{i+1}]ₓ, ∂n = (I − nnᵀ)∂N/|N|.
The Hessian is JᵀJ/σ². Limits: rotates with nothing, so m_h must be given in world axes for the present pose.
"""

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from tasks.geometry.meshes import face_normals

Array = NDArray[np.float64]


def normal_difference(vertices: Array, hinges: NDArray[np.integer]) -> Array:
    """n₁ − n₂ [H, 3] of hinges [H, 4] = (a, b, c, d) with faces (a, b, c) and (b, a, d)."""
    return face_normals(vertices, hinges[:, [0, 1, 2]]) - face_normals(vertices, hinges[:, [1, 0, 3]])


def derivatives(x: Array, hinges: NDArray[np.integer], target: Array, *, weight: float) -> tuple[Array, Array, Array]:
    """Energy [H], gradient [H, 4, 3] and Gauss–Newton Hessian [H, 4, 4, 3, 3] at vertices x [V, 3] m; target m_h [H, 3], weight 1/σ²."""
    n = len(hinges)
    energy, g, H = np.empty(n), np.empty((n, 4, 3)), np.empty((n, 4, 4, 3, 3))
    _fill(x, hinges, target, weight, energy, g, H)
    return energy, g, H


@njit(inline="always")
def _add_skew(J, corner, P, ux, uy, uz, sign):
    """J[:, corner] += sign · P [u]ₓ."""
    for a in range(3):
        J[a, corner, 0] += sign * (P[a, 1] * uz - P[a, 2] * uy)
        J[a, corner, 1] += sign * (P[a, 2] * ux - P[a, 0] * uz)
        J[a, corner, 2] += sign * (P[a, 0] * uy - P[a, 1] * ux)


@njit(inline="always")
def _add_normal(x, i0, i1, i2, c0, c1, c2, sign, r, J):
    """r += sign · n and J += sign · ∂n for the face (i0, i1, i2), whose corners are numbers c0, c1, c2 of the hinge."""
    u, v = x[i1] - x[i0], x[i2] - x[i0]
    n = np.empty(3)
    n[0], n[1], n[2] = u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]
    size = max(np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]), 1e-12)
    P = np.empty((3, 3))
    for a in range(3):
        n[a] /= size
    for a in range(3):
        r[a] += sign * n[a]
        for b in range(3):
            P[a, b] = ((1.0 if a == b else 0.0) - n[a] * n[b]) / size
    _add_skew(J, c0, P, v[0] - u[0], v[1] - u[1], v[2] - u[2], sign)
    _add_skew(J, c1, P, -v[0], -v[1], -v[2], sign)
    _add_skew(J, c2, P, u[0], u[1], u[2], sign)


@njit(parallel=True, cache=True)
def _fill(x, hinges, target, weight, energy, g, H):
    for h in prange(len(hinges)):
        a, b, c, d = hinges[h]
        r, J = -target[h], np.zeros((3, 4, 3))
        _add_normal(x, a, b, c, 0, 1, 2, 1.0, r, J)
        _add_normal(x, b, a, d, 1, 0, 3, -1.0, r, J)
        energy[h] = 0.5 * weight * (r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
        for i in range(4):
            for p in range(3):
                g[h, i, p] = weight * (J[0, i, p] * r[0] + J[1, i, p] * r[1] + J[2, i, p] * r[2])
                for j in range(4):
                    for q in range(3):
                        H[h, i, j, p, q] = weight * (J[0, i, p] * J[0, j, q] + J[1, i, p] * J[1, j, q] + J[2, i, p] * J[2, j, q])
