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
        u, _, _ = _root(c, False)
        out[f, 0], out[f, 1], out[f, 2] = u[0] - 1, u[1] - 1, 2 * u[2]
    return out


@njit(cache=True, nogil=True)
def membrane(x, faces, g, area, scale, D, stiffening, viscosity, e_hat, s, limit, z0, force, slots, data, convex):
    """Add forces [V, 3] and, through `slots` [F, 9, 9], −∂f/∂x into `data`; returns e [F, 3] and the friction stress z [F] reached.

    e_hat, s: strain rate ė = (e − e_hat)/s. limit [F]: largest friction stress [N/m] (0: none); z0 [F]: where it stood at the last state.
    convex: leave out what can make the matrix indefinite.
    """
    strain, z1 = np.empty((len(faces), 3)), np.empty(len(faces))
    dc = np.empty((3, 9))
    for f in range(len(faces)):
        c, f1, f2 = _metric(x, faces[f], g[f], scale)
        u, du, ddu = _root(c, True)
        e = np.array([u[0] - 1, u[1] - 1, 2 * u[2]])
        strain[f] = e
        De, Dd = D[f] @ e, D[f] @ (e - e_hat[f]) / s
        stretch = SHEARED * D[f, 2, 2]
        stiff = 1 + stiffening * (e @ De) / stretch
        σ, T = np.empty(3), np.empty((3, 3))
        for a in range(3):
            σ[a] = De[a] * stiff + viscosity * Dd[a]
            for b in range(3):
                T[a, b] = D[f, a, b] * (stiff + viscosity / s) + 2 * stiffening / stretch * De[a] * De[b]
        z1[f] = 0.0
        if limit[f] > 0:
            z, dz = spring_slider(z0[f, 1], e[2] - z0[f, 0], limit[f], SHEAR_REACH)
            σ[2] += z
            T[2, 2] += dz
            z1[f] = z
        # ψ_k = Σ σ_a ∂e_a/∂c_k; e₃ = 2 U₁₂
        ψ, W = np.zeros(3), np.zeros((3, 3))
        for k in range(3):
            for a in range(3):
                m = 2.0 if a == 2 else 1.0
                ψ[k] += σ[a] * m * du[a, k]
                for l in range(3):
                    if not convex:
                        W[k, l] += σ[a] * m * ddu[a, k, l]
                    for b in range(3):
                        W[k, l] += T[a, b] * m * du[a, k] * (2.0 if b == 2 else 1.0) * du[b, l]
        w = 1 / (scale * scale)
        for i in range(3):
            for d in range(3):
                dc[0, 3 * i + d] = 2 * g[f, i, 0] * f1[d] * w
                dc[1, 3 * i + d] = 2 * g[f, i, 1] * f2[d] * w
                dc[2, 3 * i + d] = (g[f, i, 0] * f2[d] + g[f, i, 1] * f1[d]) * w
        Wdc = W @ dc
        S = _tension(ψ) if convex else ψ
        A = area[f]
        for p in range(9):
            force[faces[f, p // 3], p % 3] -= A * (ψ[0] * dc[0, p] + ψ[1] * dc[1, p] + ψ[2] * dc[2, p])
            for q in range(9):
                slot = slots[f, p, q]
                if slot < 0:
                    continue
                h = dc[0, p] * Wdc[0, q] + dc[1, p] * Wdc[1, q] + dc[2, p] * Wdc[2, q]
                if p % 3 == q % 3:
                    i, j = p // 3, q // 3
                    h += w * (
                        2 * S[0] * g[f, i, 0] * g[f, j, 0]
                        + 2 * S[1] * g[f, i, 1] * g[f, j, 1]
                        + S[2] * (g[f, i, 0] * g[f, j, 1] + g[f, i, 1] * g[f, j, 0])
                    )
                data[slot] += A * h
    return strain, z1


@njit(cache=True, nogil=True)
def _metric(x, face, g, scale):
    """(C₁₁, C₂₂, C₁₂) and the columns of F."""
    f1, f2 = np.zeros(3), np.zeros(3)
    for i in range(3):
        for d in range(3):
            f1[d] += g[i, 0] * x[face[i], d]
            f2[d] += g[i, 1] * x[face[i], d]
    w = 1 / (scale * scale)
    c = np.array([w * (f1 @ f1), w * (f2 @ f2), w * (f1 @ f2)])
    return c, f1, f2


@njit(cache=True, nogil=True)
def _root(c, derivatives):
    """(U₁₁, U₂₂, U₁₂) with first [3, 3] and second [3, 3, 3] derivatives in (C₁₁, C₂₂, C₁₂)."""
    J = np.sqrt(max(c[0] * c[1] - c[2] ** 2, 1e-6))
    τ = np.sqrt(c[0] + c[1] + 2 * J)
    u = np.array([(c[0] + J) / τ, (c[1] + J) / τ, c[2] / τ])
    du, ddu = np.zeros((3, 3)), np.zeros((3, 3, 3))
    if not derivatives:
        return u, du, ddu
    dJ = np.array([c[1] / (2 * J), c[0] / (2 * J), -c[2] / J])
    dτ = np.array([(1 + 2 * dJ[0]) / (2 * τ), (1 + 2 * dJ[1]) / (2 * τ), dJ[2] / τ])
    ddet = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -2.0]])
    for a in range(3):
        for k in range(3):
            n = (1.0 if a == k else 0.0) + (dJ[k] if a < 2 else 0.0)
            du[a, k] = (n - u[a] * dτ[k]) / τ
    for k in range(3):
        for l in range(3):
            ddJ = (ddet[k, l] / 2 - dJ[k] * dJ[l]) / J
            ddτ = (ddJ - dτ[k] * dτ[l]) / τ
            for a in range(3):
                n = ddJ if a < 2 else 0.0
                ddu[a, k, l] = (n - du[a, l] * dτ[k] - u[a] * ddτ - du[a, k] * dτ[l]) / τ
    return u, du, ddu


@njit(cache=True, nogil=True)
def _tension(ψ):
    """The stress without its compressive part."""
    a, b, c = 2 * ψ[0], 2 * ψ[1], ψ[2]
    mean, r = (a + b) / 2, np.sqrt(((a - b) / 2) ** 2 + c * c)
    if mean - r >= 0:
        return ψ
    if mean + r <= 0:
        return np.zeros(3)
    # one positive eigenvalue λ with direction n: λ n nᵀ
    λ = mean + r
    n1, n2 = (λ - b, c) if abs(λ - b) > abs(λ - a) else (c, λ - a)
    norm = max(n1 * n1 + n2 * n2, 1e-300)
    return np.array([λ * n1 * n1 / norm / 2, λ * n2 * n2 / norm / 2, λ * n1 * n2 / norm])
