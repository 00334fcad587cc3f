"""In-plane forces of the generator: Biot strain in the rest frame, with viscosity, shear hysteresis and stiffening.

    U = √C = (C + J I)/√(tr C + 2J),   J = √det C,   C = FᵀF/s²        e = (U₁₁ − 1, U₂₂ − 1, 2U₁₂)
    σ = 𝔻 e (1 + c q) + β 𝔻 ė + (0, 0, z),  q = eᵀ𝔻e/(E t)              f = −A ∂eᵀ/∂x σ

1 is weft, 2 is warp; s scales rest lengths. z is a friction stress (`spring_slider.py`) on the shear e₃.
Source: the square root of a 2 × 2 tensor, Hoger & Carlson 1984.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tasks.exam.generator.spring_slider import spring_slider
from tasks.geometry.simplex_distances import along, dot, row, scaled

Array = NDArray[np.float64]
POISSON = 0.071
SHEARED = 2 * (1 + POISSON)  # E t over the shear modulus
SHEAR_REACH = 6e-3  # shear over which friction builds up


def moduli(stretch: Array, orthotropy: float) -> Array:
    """𝔻 [F, 3, 3] N/m of stiffness E·t [F] N/m: Young's moduli E e^±orthotropy along weft and warp, shear as if isotropic."""
    weft, warp = stretch * np.exp(orthotropy), stretch * np.exp(-orthotropy)
    coupling = POISSON * np.sqrt(weft * warp)
    D = np.zeros((len(stretch), 3, 3))
    D[:, 0, 0], D[:, 1, 1], D[:, 0, 1], D[:, 1, 0] = weft, warp, coupling, coupling
    D[:, :2, :2] /= 1 - POISSON**2
    D[:, 2, 2] = stretch / SHEARED
    return D


@njit(cache=True, nogil=True)
def biot_strain(x, faces, g, scale):
    """e [F, 3] of positions x; g [F, 3, 2] 1/m gradients of the corners' hat functions in the pattern."""
    out = np.empty((len(faces), 3))
    for f in range(len(faces)):
        c, _, _ = _metric(x, faces[f], g[f], scale)
        u, _, _ = _root(c)
        out[f, 0], out[f, 1], out[f, 2] = u[0] - 1, u[1] - 1, 2 * u[2]
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def membrane(x, faces, g, area, scale, D, stiffening, viscosity, e_hat, s, limit, z0, force, slots, data, convex):
    """Add forces [V, 3] and, through `slots` [F, 9, 9], −∂f/∂x into `data`; returns e [F, 3] and the friction stress z [F] reached.

    e_hat, s: strain rate ė = (e − e_hat)/s. limit [F]: largest friction stress [N/m] (0: none); z0 [F]: where it stood at the last state.
    convex: leave out what can make the matrix indefinite.
    """
    strain, z1 = np.empty((len(faces), 3)), np.empty(len(faces))
    De, σ, T, ψ, W = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    de, Tde, dde = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3, 3))  # ∂e/∂c, 𝔻' ∂e/∂c, ∂²e/∂c²
    dc, Wdc = np.empty((3, 9)), np.empty((3, 9))
    w = 1 / (scale * scale)
    for f in range(len(faces)):
        c, f1, f2 = _metric(x, faces[f], g[f], scale)
        u, J, τ = _root(c)
        _slopes(c, u, J, τ, de, dde)
        e = (u[0] - 1, u[1] - 1, 2 * u[2])
        energy = 0.0
        for a in range(3):
            strain[f, a] = e[a]
            De[a] = D[f, a, 0] * e[0] + D[f, a, 1] * e[1] + D[f, a, 2] * e[2]
            energy += e[a] * De[a]
        stretch = SHEARED * D[f, 2, 2]
        stiff = 1 + stiffening * energy / stretch
        for a in range(3):
            σ[a] = De[a] * stiff
            for b in range(3):
                σ[a] += viscosity * D[f, a, b] * (e[b] - e_hat[f, b]) / s
                T[a, b] = D[f, a, b] * (stiff + viscosity / s) + 2 * stiffening / stretch * De[a] * De[b]
        z1[f] = 0.0
        if limit[f] > 0:
            z, dz = spring_slider(z0[f, 1], e[2] - z0[f, 0], limit[f], SHEAR_REACH)
            σ[2] += z
            T[2, 2] += dz
            z1[f] = z
        # ψ_k = Σ σ_a ∂e_a/∂c_k,  W = ∂ψ/∂c
        for k in range(3):
            ψ[k] = σ[0] * de[0, k] + σ[1] * de[1, k] + σ[2] * de[2, k]
            for a in range(3):
                Tde[a, k] = T[a, 0] * de[0, k] + T[a, 1] * de[1, k] + T[a, 2] * de[2, k]
        for k in range(3):
            for l in range(3):
                W[k, l] = de[0, k] * Tde[0, l] + de[1, k] * Tde[1, l] + de[2, k] * Tde[2, l]
                if not convex:
                    W[k, l] += σ[0] * dde[0, k, l] + σ[1] * dde[1, k, l] + σ[2] * dde[2, k, l]
        for i in range(3):
            for d in range(3):
                dc[0, 3 * i + d] = 2 * g[f, i, 0] * f1[d] * w
                dc[1, 3 * i + d] = 2 * g[f, i, 1] * f2[d] * w
                dc[2, 3 * i + d] = (g[f, i, 0] * f2[d] + g[f, i, 1] * f1[d]) * w
        for k in range(3):
            for p in range(9):
                Wdc[k, p] = W[k, 0] * dc[0, p] + W[k, 1] * dc[1, p] + W[k, 2] * dc[2, p]
        S = _tension(ψ[0], ψ[1], ψ[2]) if convex else (ψ[0], ψ[1], ψ[2])
        A = area[f]
        for i in range(3):
            for j in range(3):
                held = w * (
                    2 * S[0] * g[f, i, 0] * g[f, j, 0]
                    + 2 * S[1] * g[f, i, 1] * g[f, j, 1]
                    + S[2] * (g[f, i, 0] * g[f, j, 1] + g[f, i, 1] * g[f, j, 0])
                )
                for p in range(3 * i, 3 * i + 3):
                    for q in range(3 * j, 3 * j + 3):
                        slot = slots[f, p, q]
                        if slot >= 0:
                            h = dc[0, p] * Wdc[0, q] + dc[1, p] * Wdc[1, q] + dc[2, p] * Wdc[2, q]
                            data[slot] += A * (h + held if p - 3 * i == q - 3 * j else h)
            for d in range(3):
                p = 3 * i + d
                force[faces[f, i], d] -= A * (ψ[0] * dc[0, p] + ψ[1] * dc[1, p] + ψ[2] * dc[2, p])
    return strain, z1


@njit(cache=True, nogil=True)
def _metric(x, face, g, scale):
    """(C₁₁, C₂₂, C₁₂) and the columns of F."""
    f1, f2 = _column(x, face, g, 0), _column(x, face, g, 1)
    w = 1 / (scale * scale)
    return (w * dot(f1, f1), w * dot(f2, f2), w * dot(f1, f2)), f1, f2


@njit(cache=True, nogil=True)
def _column(x, face, g, a):
    """f_a = Σ g_ia x_i."""
    return along(along(scaled(g[0, a], row(x, face[0])), g[1, a], row(x, face[1])), g[2, a], row(x, face[2]))


@njit(cache=True, nogil=True)
def _root(c):
    """(U₁₁, U₂₂, U₁₂), J and τ = tr U."""
    J = np.sqrt(max(c[0] * c[1] - c[2] ** 2, 1e-6))
    τ = np.sqrt(c[0] + c[1] + 2 * J)
    return ((c[0] + J) / τ, (c[1] + J) / τ, c[2] / τ), J, τ


@njit(cache=True, nogil=True, error_model="numpy")
def _slopes(c, u, J, τ, de, dde):
    """First [3, 3] and second [3, 3, 3] derivatives of e in (C₁₁, C₂₂, C₁₂)."""
    dJ = (c[1] / (2 * J), c[0] / (2 * J), -c[2] / J)
    dτ = ((1 + 2 * dJ[0]) / (2 * τ), (1 + 2 * dJ[1]) / (2 * τ), dJ[2] / τ)
    for a in range(3):
        for k in range(3):
            n = (1.0 if a == k else 0.0) + (dJ[k] if a < 2 else 0.0)
            de[a, k] = (n - u[a] * dτ[k]) / τ
    for k in range(3):
        for l in range(3):
            ddet = -2.0 if k == l == 2 else 1.0 if k + l == 1 else 0.0
            ddJ = (ddet / 2 - dJ[k] * dJ[l]) / J
            ddτ = (ddJ - dτ[k] * dτ[l]) / τ
            for a in range(3):
                n = ddJ if a < 2 else 0.0
                dde[a, k, l] = (n - de[a, l] * dτ[k] - u[a] * ddτ - de[a, k] * dτ[l]) / τ
    for k in range(3):  # e₃ = 2 U₁₂
        de[2, k] *= 2
        for l in range(3):
            dde[2, k, l] *= 2


@njit(cache=True, nogil=True)
def _tension(ψ1, ψ2, ψ3):
    """The stress without its compressive part."""
    a, b, c = 2 * ψ1, 2 * ψ2, ψ3
    mean, r = (a + b) / 2, np.sqrt(((a - b) / 2) ** 2 + c * c)
    if mean - r >= 0:
        return ψ1, ψ2, ψ3
    if mean + r <= 0:
        return 0.0, 0.0, 0.0
    # one positive eigenvalue λ with direction n: λ n nᵀ
    λ = mean + r
    n1, n2 = (λ - b, c) if abs(λ - b) > abs(λ - a) else (c, λ - a)
    norm = max(n1 * n1 + n2 * n2, 1e-300)
    return λ * n1 * n1 / norm / 2, λ * n2 * n2 / norm / 2, λ * n1 * n2 / norm
