"""Green strain of a triangle and what any material that is a function of it needs: gradient and Hessian in the corner positions.

    F = [f₁ f₂] = [x₁ − x₀, x₂ − x₀] D̄⁻¹ (3×2),   C = FᵀF,   E = ½(C − I),   ψ = ψ(E) [J/m²]
    S = ∂ψ/∂E,  𝔻 = ∂S/∂E  in Voigt order (11, 22, 12), the last strain being 2 E₁₂
    ∂P/∂x_p    = Ā [ S₁₁ f₁ N_p1 + S₂₂ f₂ N_p2 + S₁₂ (f₁ N_p2 + f₂ N_p1) ]
    ∂²P/∂x_p∂x_q = Ā [ B_pᵀ 𝔻 B_q + (N_p · S · N_q) I ],   B_p = ∂(E₁₁, E₂₂, 2E₁₂)/∂x_p

The convex neighbour replaces S by its positive part (2×2 eigenvalues): tension stiffens the triangle sideways, compression does not
soften it.

Source: Bonet & Wood, Nonlinear Continuum Mechanics, §9.3 (membranes). Limits: constant strain per triangle.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int32]


def rest_frames(x_rest: Array, faces: Indices, uv: Array | None = None) -> tuple[Array, Array]:
    """Shape gradients N [F, 3, 2] 1/m (corner, rest direction) and rest areas Ā [F] m².

    With uv [F, 3, 2] m the rest directions are those of the pattern (u weft, v warp); without, the first lies along edge 0→1 of the face.
    """
    flat = uv if uv is not None else _lay_flat(x_rest[faces])
    D = np.stack([flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]], axis=2)
    D_inverse = np.linalg.inv(D)
    N = np.concatenate([-D_inverse.sum(1, keepdims=True), D_inverse], axis=1)
    return np.ascontiguousarray(N), np.abs(np.linalg.det(D)) / 2


@njit(cache=True, nogil=True, error_model="numpy")
def metric(x: Array, faces: Indices, N: Array) -> Array:
    """C [F, 3] = (C₁₁, C₂₂, C₁₂)."""
    C = np.zeros((len(faces), 3))
    for i in range(len(faces)):
        for k in range(3):
            f1, f2 = _column(x, faces[i], N[i], 0, k), _column(x, faces[i], N[i], 1, k)
            C[i, 0] += f1 * f1
            C[i, 1] += f2 * f2
            C[i, 2] += f1 * f2
    return C


@njit(cache=True, nogil=True, error_model="numpy")
def gradient(x: Array, faces: Indices, N: Array, area: Array, S: Array) -> Array:
    """Σ ∂P/∂x [V, 3] N for stresses S [F, 3] N/m."""
    g = np.zeros_like(x)
    for i in range(len(faces)):
        for k in range(3):
            f1, f2 = _column(x, faces[i], N[i], 0, k), _column(x, faces[i], N[i], 1, k)
            for p in range(3):
                a = S[i, 0] * N[i, p, 0] + S[i, 2] * N[i, p, 1]
                b = S[i, 1] * N[i, p, 1] + S[i, 2] * N[i, p, 0]
                g[faces[i, p], k] += area[i] * (a * f1 + b * f2)
    return g


@njit(cache=True, nogil=True, error_model="numpy")
def hessian(x: Array, faces: Indices, N: Array, area: Array, S: Array, D: Array, convex: bool) -> Array:
    """∂²P/∂x² [F, 9, 9] N/m for stresses S [F, 3] and stiffnesses D [F, 3, 3] N/m."""
    H = np.empty((len(faces), 9, 9))
    B = np.empty((3, 9))
    for i in range(len(faces)):
        for k in range(3):
            f1, f2 = _column(x, faces[i], N[i], 0, k), _column(x, faces[i], N[i], 1, k)
            for p in range(3):
                B[0, 3 * p + k] = f1 * N[i, p, 0]
                B[1, 3 * p + k] = f2 * N[i, p, 1]
                B[2, 3 * p + k] = f1 * N[i, p, 1] + f2 * N[i, p, 0]
        s11, s22, s12 = S[i]
        if convex:
            s11, s22, s12 = _positive_part(s11, s22, s12)
        for r in range(9):
            b0 = D[i, 0, 0] * B[0, r] + D[i, 0, 1] * B[1, r] + D[i, 0, 2] * B[2, r]
            b1 = D[i, 1, 0] * B[0, r] + D[i, 1, 1] * B[1, r] + D[i, 1, 2] * B[2, r]
            b2 = D[i, 2, 0] * B[0, r] + D[i, 2, 1] * B[1, r] + D[i, 2, 2] * B[2, r]
            for c in range(9):
                H[i, r, c] = area[i] * (b0 * B[0, c] + b1 * B[1, c] + b2 * B[2, c])
        for p in range(3):
            for q in range(3):
                u = N[i, p, 0] * (s11 * N[i, q, 0] + s12 * N[i, q, 1]) + N[i, p, 1] * (s12 * N[i, q, 0] + s22 * N[i, q, 1])
                for k in range(3):
                    H[i, 3 * p + k, 3 * q + k] += area[i] * u
    return H


def _lay_flat(corners: Array) -> Array:
    """Corners [F, 3, 3] -> [F, 3, 2], lengths and orientation kept."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    length = np.linalg.norm(a, axis=1)
    along = np.sum(a * b, 1) / length
    across = np.linalg.norm(np.cross(a, b), axis=1) / length
    zero = np.zeros_like(length)
    return np.stack([np.stack([zero, zero], 1), np.stack([length, zero], 1), np.stack([along, across], 1)], axis=1)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _column(x, face, N, a, k):
    """Component k of f_a."""
    return x[face[0], k] * N[0, a] + x[face[1], k] * N[1, a] + x[face[2], k] * N[2, a]


@njit(cache=True, nogil=True, error_model="numpy")
def _positive_part(s11, s22, s12):
    mean, radius = (s11 + s22) / 2, np.sqrt(((s11 - s22) / 2) ** 2 + s12**2)
    high, low = mean + radius, mean - radius
    if low >= 0:
        return s11, s22, s12
    if high <= 0:
        return 0.0, 0.0, 0.0
    c = high / (high - low)  # high · (S − low I)/(high − low) keeps the tensile direction only
    return c * (s11 - low), c * (s22 - low), c * s12
