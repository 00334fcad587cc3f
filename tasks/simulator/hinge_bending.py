"""Discrete hinges: bending energy of the angle between neighbouring triangles.

    P = Σ k (θ − θ̄)² |ē|/h̄,   h̄ = (Ā₁ + Ā₂)/(3|ē|)   ⇒   P = Σ 3k |ē|²/(Ā₁ + Ā₂) (θ − θ̄)²
    ∂θ/∂c = −|e| w₁,  ∂θ/∂d = −|e| w₂,  ∂θ/∂a = ((b−c)·ê) w₁ + ((b−d)·ê) w₂,  ∂θ/∂b = ((c−a)·ê) w₁ + ((d−a)·ê) w₂,   w = N/|N|²

for the hinge (a, b, c, d): shared edge e = b − a, opposite corners c and d, area vectors N₁ = (b−a)×(c−a), N₂ = (a−b)×(d−b);
θ is the angle from N₁ to N₂ about e. The Hessian follows by differentiating w and the factors before it.

Source: Grinspun et al. 2003 (discrete shells); gradient as in Bridson, Marino, Fedkiw 2003. Limits: θ jumps by 2π for cloth folded
beyond π, which contact excludes. The convex neighbour is Gauss-Newton: it drops (θ − θ̄) ∂²θ.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from typing_extensions import override

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
    @override
    def parameters(self) -> tuple[str, ...]:
        return ("log_bending", "log_membrane") if self.coupled else ("log_bending",)

    @classmethod
    def of(cls, cloth: Cloth, fabric: Fabric, *, coupled: bool = False) -> Self:
        """The base bending of a cloth."""
        hinges = cloth.hinges
        k = fabric.hinge_constant * (fabric.membrane if coupled else 1.0)
        θ = angles(cloth.x_rest, hinges)
        return cls(hinges, k * hinge_shape(cloth), θ if cloth.rest_angles == "worn" else np.zeros_like(θ), coupled)

    @override
    def energy(self, x: Array, step: Step) -> float:
        return float(self.weight @ (angles(x, self.hinges) - self.rest_angle) ** 2)

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return _gradient(x, self.hinges, self.weight, self.rest_angle)

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        return Blocks(self.hinges, _hessian(x, self.hinges, self.weight, self.rest_angle, convex))

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        if name not in self.parameters:
            raise KeyError(name)
        return self.gradient(x, step)


def hinge_shape(cloth: Cloth) -> Array:
    """|ē|/h̄ = 3|ē|²/(Ā₁ + Ā₂) [H], lengths of the worn rest mesh."""
    a, b, c, d = cloth.hinges.T
    first, second = (face_areas(cloth.x_rest, np.column_stack(corners).astype(np.int32)) for corners in ((a, b, c), (b, a, d)))
    return 3 * np.sum((cloth.x_rest[b] - cloth.x_rest[a]) ** 2, 1) / (first + second)


def folds(cloth: Cloth) -> csr_matrix:
    """∂θ/∂z [H, V] rad/m of hinges laid flat by deflections z [V] m across the cloth: of a corner 1/h, of the edge's ends −(1 − x/|e|)/h
    and −x/(|e| h), for both corners of height h over the edge and foot x on it.
    """
    a, b, *corners = cloth.hinges.T
    edge = cloth.x_rest[b] - cloth.x_rest[a]
    length = np.linalg.norm(edge, axis=1)
    ê, hinge, found = edge / length[:, None], np.arange(len(a)), []
    for corner in corners:
        side = cloth.x_rest[corner] - cloth.x_rest[a]
        foot = np.sum(side * ê, 1)
        h = np.linalg.norm(side - foot[:, None] * ê, axis=1)
        found += [(corner, 1 / h), (a, (foot / length - 1) / h), (b, -foot / length / h)]
    vertices, values = (np.concatenate(each) for each in zip(*found, strict=True))
    return csr_matrix((values, (np.tile(hinge, len(found)), vertices)), (len(a), len(cloth.x_rest)))


def angles(x: Array, hinges: Indices) -> Array:
    """θ [H] rad of each hinge; 0 is flat."""
    return _angles(x, hinges)


def angle_gradients(x: Array, hinges: Indices) -> Array:
    """∂θ/∂(a, b, c, d) [H, 4, 3] 1/m."""
    return _angle_gradients(x, hinges)


def angle_hessians(x: Array, hinges: Indices) -> Array:
    """∂²θ/∂(a, b, c, d)² [H, 12, 12] 1/m² (order: vertex, then axis)."""
    return _angle_hessians(x, hinges)


@njit(cache=True, nogil=True, error_model="numpy")
def _angles(x, hinges):
    θ = np.empty(len(hinges))
    e, w, α = np.empty(3), np.empty((2, 3)), np.zeros((2, 4))
    for i in range(len(hinges)):
        θ[i] = _measure(x, hinges[i], e, w, α)
    return θ


@njit(cache=True, nogil=True, error_model="numpy")
def _angle_gradients(x, hinges):
    G = np.empty((len(hinges), 4, 3))
    e, w, α = np.empty(3), np.empty((2, 3)), np.zeros((2, 4))
    for i in range(len(hinges)):
        _measure(x, hinges[i], e, w, α)
        for p in range(4):
            for k in range(3):
                G[i, p, k] = α[0, p] * w[0, k] + α[1, p] * w[1, k]
    return G


@njit(cache=True, nogil=True, error_model="numpy")
def _angle_hessians(x, hinges):
    H = np.zeros((len(hinges), 12, 12))
    e, w, α = np.empty(3), np.empty((2, 3)), np.zeros((2, 4))
    for i in range(len(hinges)):
        _measure(x, hinges[i], e, w, α)
        _add_angle_hessian(H[i], 1.0, x, hinges[i], e, w, α)
    return H


@njit(cache=True, nogil=True, error_model="numpy")
def _gradient(x, hinges, weight, rest_angle):
    G = np.zeros_like(x)
    e, w, α = np.empty(3), np.empty((2, 3)), np.zeros((2, 4))
    for i in range(len(hinges)):
        moment = 2 * weight[i] * (_measure(x, hinges[i], e, w, α) - rest_angle[i])
        for p in range(4):
            for k in range(3):
                G[hinges[i, p], k] += moment * (α[0, p] * w[0, k] + α[1, p] * w[1, k])
    return G


@njit(cache=True, nogil=True, error_model="numpy")
def _hessian(x, hinges, weight, rest_angle, convex):
    H = np.empty((len(hinges), 12, 12))
    e, w, α, g = np.empty(3), np.empty((2, 3)), np.zeros((2, 4)), np.empty(12)
    for i in range(len(hinges)):
        moment = 2 * weight[i] * (_measure(x, hinges[i], e, w, α) - rest_angle[i])
        for p in range(4):
            for k in range(3):
                g[3 * p + k] = α[0, p] * w[0, k] + α[1, p] * w[1, k]
        for r in range(12):
            for c in range(12):
                H[i, r, c] = 2 * weight[i] * g[r] * g[c]
        if not convex:
            _add_angle_hessian(H[i], moment, x, hinges[i], e, w, α)
    return H


@njit(cache=True, nogil=True, error_model="numpy")
def _measure(x, hinge, e, w, α):
    """θ of one hinge; fills the edge e [3], the wing vectors w [2, 3] and the factors α [2, 4] of ∂θ = α₀ w₀ + α₁ w₁."""
    a, b, c, d = hinge
    length = 0.0
    for k in range(3):
        e[k] = x[b, k] - x[a, k]
        length += e[k] ** 2
    length = np.sqrt(length)
    α[0, 0], α[0, 1], α[0, 2] = 0.0, 0.0, -length
    α[1, 0], α[1, 1], α[1, 3] = 0.0, 0.0, -length
    for k in range(3):
        l = (k + 1) % 3
        m = (k + 2) % 3
        w[0, k] = e[l] * (x[c, m] - x[a, m]) - e[m] * (x[c, l] - x[a, l])
        w[1, k] = (x[d, l] - x[b, l]) * e[m] - (x[d, m] - x[b, m]) * e[l]
        ê = e[k] / length
        α[0, 0] += (x[b, k] - x[c, k]) * ê
        α[0, 1] += (x[c, k] - x[a, k]) * ê
        α[1, 0] += (x[b, k] - x[d, k]) * ê
        α[1, 1] += (x[d, k] - x[a, k]) * ê
    n0, n1, cosine, sine = 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        l = (k + 1) % 3
        m = (k + 2) % 3
        n0 += w[0, k] ** 2
        n1 += w[1, k] ** 2
        cosine += w[0, k] * w[1, k]
        sine += (w[0, l] * w[1, m] - w[0, m] * w[1, l]) * e[k]
    for k in range(3):
        w[0, k] /= n0
        w[1, k] /= n1
    return np.arctan2(sine, cosine * length)


@njit(cache=True, nogil=True, error_model="numpy")
def _add_angle_hessian(H, moment, x, hinge, e, w, α):
    """H [12, 12] += moment ∂²θ:  Σ over wings  w ⊗ ∂α + α (|w|² − 2 w wᵀ) [∂N]."""
    a, b = hinge[0], hinge[1]
    length = np.sqrt(e[0] ** 2 + e[1] ** 2 + e[2] ** 2)
    arm, dα, dw = np.empty((4, 3)), np.zeros((4, 4, 3)), np.empty((3, 3))
    for wing in range(2):
        slot = 2 + wing
        o = hinge[slot]
        sign = 1.0 if wing == 0 else -1.0
        ww = w[wing, 0] ** 2 + w[wing, 1] ** 2 + w[wing, 2] ** 2
        for k in range(3):
            ê = e[k] / length
            pb = (x[b, k] - x[o, k] - α[wing, 0] * ê) / length  # parts of the wing's sides across the edge
            pa = (x[o, k] - x[a, k] - α[wing, 1] * ê) / length
            dα[slot, 0, k], dα[slot, 1, k], dα[slot, slot, k] = ê, -ê, 0.0
            dα[0, 0, k], dα[0, 1, k], dα[0, slot, k] = -pb, ê + pb, -ê
            dα[1, 0, k], dα[1, 1, k], dα[1, slot, k] = -ê - pa, pa, ê
            arm[0, k], arm[1, k], arm[slot, k] = sign * (x[o, k] - x[b, k]), sign * (x[a, k] - x[o, k]), sign * e[k]  # ∂N = [arm]×
        for q in (0, 1, slot):
            for k in range(3):
                l = (k + 1) % 3
                m = (k + 2) % 3
                along = 2 * (w[wing, l] * arm[q, m] - w[wing, m] * arm[q, l])  # arm × unit_k has arm_m at l and −arm_l at m
                for r in range(3):
                    dw[r, k] = -along * w[wing, r]
                dw[l, k] += ww * arm[q, m]
                dw[m, k] -= ww * arm[q, l]
            for p in (0, 1, slot):
                for r in range(3):
                    for k in range(3):
                        H[3 * p + r, 3 * q + k] += moment * (w[wing, r] * dα[p, q, k] + α[wing, p] * dw[r, k])
