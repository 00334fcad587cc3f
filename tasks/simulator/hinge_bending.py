"""Discrete hinges: bending energy of the angle between neighbouring triangles.

    P = Σ k (θ − θ̄)² |ē|/h̄,   h̄ = (Ā₁ + Ā₂)/(3|ē|)   ⇒   P = Σ 3k |ē|²/(Ā₁ + Ā₂) (θ − θ̄)²
    ∂θ/∂c = −|e| w₁,  ∂θ/∂d = −|e| w₂,  ∂θ/∂a = ((b−c)·ê) w₁ + ((b−d)·ê) w₂,  ∂θ/∂b = ((c−a)·ê) w₁ + ((d−a)·ê) w₂,   w = N/|N|²

for the hinge (a, b, c, d): shared edge e = b − a, opposite corners c and d, area vectors N₁ = (b−a)×(c−a), N₂ = (a−b)×(d−b);
θ is the angle from N₁ to N₂ about e. The Hessian follows by differentiating w and the factors before it.

Source: Grinspun et al. 2003 (discrete shells); gradient as in Bridson, Marino, Fedkiw 2003. Limits: θ jumps by 2π for cloth folded beyond π,
which contact excludes. The convex neighbour is Gauss-Newton: it drops (θ − θ̄) ∂²θ.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tasks.geometry.meshes import face_areas
from tasks.simulator.cloth import Cloth
from tasks.simulator.fabric import Fabric
from tasks.simulator.potential import Blocks, Potential, Step

Array = NDArray[np.float64]
Indices = NDArray[np.int32]


@dataclass(frozen=True)
class HingeBending(Potential):
    """Hinges [H, 4], weights 3k|ē|²/(Ā₁ + Ā₂) [H] J, rest angles [H] rad; `coupled`: k carries κ_s as well."""

    hinges: Indices
    weight: Array
    rest_angle: Array
    coupled: bool = False

    @property
    def parameters(self) -> tuple[str, ...]:
        return ("log_bending", "log_membrane") if self.coupled else ("log_bending",)

    @classmethod
    def of(cls, cloth: Cloth, fabric: Fabric, *, coupled: bool = False) -> Self:
        """The base bending of a cloth."""
        hinges = cloth.hinges
        k = fabric.hinge_constant * (fabric.membrane if coupled else 1.0)
        θ = angles(cloth.x_rest, hinges)
        return cls(hinges, k * hinge_shape(cloth), θ if cloth.rest_angles == "worn" else np.zeros_like(θ), coupled)

    def energy(self, x: Array, step: Step) -> float:
        return float(self.weight @ (angles(x, self.hinges) - self.rest_angle) ** 2)

    def gradient(self, x: Array, step: Step) -> Array:
        return _gradient(x, self.hinges, self.weight, self.rest_angle)

    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        return Blocks(self.hinges, _hessian(x, self.hinges, self.weight, self.rest_angle, convex))

    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        if name not in self.parameters:
            raise KeyError(name)
        return self.gradient(x, step)


def hinge_shape(cloth: Cloth) -> Array:
    """|ē|/h̄ = 3|ē|²/(Ā₁ + Ā₂) [H], lengths of the worn rest mesh."""
    a, b, c, d = cloth.hinges.T
    first, second = (face_areas(cloth.x_rest, np.column_stack(corners).astype(np.int32)) for corners in ((a, b, c), (b, a, d)))
    return 3 * np.sum((cloth.x_rest[b] - cloth.x_rest[a]) ** 2, 1) / (first + second)


@njit(cache=True, nogil=True)
def angles(x: Array, hinges: Indices) -> Array:
    """θ [H] rad of each hinge; 0 is flat."""
    θ = np.empty(len(hinges))
    for i in range(len(hinges)):
        a, b, c, d = x[hinges[i, 0]], x[hinges[i, 1]], x[hinges[i, 2]], x[hinges[i, 3]]
        e = b - a
        N1, N2 = _cross(e, c - a), _cross(d - b, e)
        θ[i] = np.arctan2(_dot(_cross(N1, N2), e), _dot(N1, N2) * np.sqrt(_dot(e, e)))
    return θ


@njit(cache=True, nogil=True)
def angle_gradient(a, b, c, d):
    """∂θ/∂(a, b, c, d) [4, 3] 1/m, with the two wing vectors w [2, 3] and the factors α [2, 4] before them."""
    e = b - a
    length = np.sqrt(_dot(e, e))
    ê = e / length
    N1, N2 = _cross(e, c - a), _cross(d - b, e)
    w, α = np.empty((2, 3)), np.zeros((2, 4))
    w[0], w[1] = N1 / _dot(N1, N1), N2 / _dot(N2, N2)
    α[0, 0], α[0, 1], α[0, 2] = _dot(b - c, ê), _dot(c - a, ê), -length
    α[1, 0], α[1, 1], α[1, 3] = _dot(b - d, ê), _dot(d - a, ê), -length
    g = np.empty((4, 3))
    for p in range(4):
        g[p] = α[0, p] * w[0] + α[1, p] * w[1]
    return g, w, α


@njit(cache=True, nogil=True)
def angle_hessian(a, b, c, d, w, α):
    """∂²θ/∂(a, b, c, d)² [12, 12] 1/m²:  Σ over wings  w ⊗ ∂α + α (I − 2 n nᵀ)/|N|² [∂N]."""
    H = np.zeros((12, 12))
    e = b - a
    length = np.sqrt(_dot(e, e))
    ê = e / length
    for wing in range(2):
        o = c if wing == 0 else d
        slot = 2 + wing
        pb, pa = (b - o) - _dot(b - o, ê) * ê, (o - a) - _dot(o - a, ê) * ê
        dα = np.zeros((4, 4, 3))  # ∂α_p/∂x_q
        dα[slot, 0], dα[slot, 1] = ê, -ê
        dα[0, 0], dα[0, 1], dα[0, slot] = -pb / length, ê + pb / length, -ê
        dα[1, 0], dα[1, 1], dα[1, slot] = -ê - pa / length, pa / length, ê
        sign = 1.0 if wing == 0 else -1.0
        arm = np.zeros((4, 3))  # ∂N/∂x_q = [arm_q]×
        arm[0], arm[1], arm[slot] = sign * (o - b), sign * (a - o), sign * e
        ww = _dot(w[wing], w[wing])
        for q in range(4):
            if q == 5 - slot:
                continue
            for k in range(3):
                u = np.zeros(3)
                u[k] = 1.0
                dN = _cross(arm[q], u)
                dw = ww * dN - 2 * _dot(w[wing], dN) * w[wing]
                for p in range(4):
                    for r in range(3):
                        H[3 * p + r, 3 * q + k] += w[wing, r] * dα[p, q, k] + α[wing, p] * dw[r]
    return H


@njit(cache=True, nogil=True)
def _gradient(x, hinges, weight, rest_angle):
    G = np.zeros_like(x)
    θ = angles(x, hinges)
    for i in range(len(hinges)):
        g, _, _ = angle_gradient(x[hinges[i, 0]], x[hinges[i, 1]], x[hinges[i, 2]], x[hinges[i, 3]])
        for p in range(4):
            G[hinges[i, p]] += 2 * weight[i] * (θ[i] - rest_angle[i]) * g[p]
    return G


@njit(cache=True, nogil=True)
def _hessian(x, hinges, weight, rest_angle, convex):
    H = np.empty((len(hinges), 12, 12))
    θ = angles(x, hinges)
    for i in range(len(hinges)):
        a, b, c, d = x[hinges[i, 0]], x[hinges[i, 1]], x[hinges[i, 2]], x[hinges[i, 3]]
        g, w, α = angle_gradient(a, b, c, d)
        flat = g.ravel()
        H[i] = 2 * weight[i] * np.outer(flat, flat)
        if not convex:
            H[i] += 2 * weight[i] * (θ[i] - rest_angle[i]) * angle_hessian(a, b, c, d, w, α)
    return H


@njit(cache=True, nogil=True)
def _cross(a, b):
    out = np.empty(3)
    out[0], out[1], out[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return out


@njit(cache=True, nogil=True)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
