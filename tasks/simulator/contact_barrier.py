"""Contact as a barrier: surfaces repel when closer than d̂ and never touch.

    P = Σ_pairs κ a b(d),   b = −(d² − d̂²)² ln(d²/d̂²)/d̂⁴,   κ = c ρ̄ d̂        a: contact area of the pair [m²]

d is the distance less the thickness offset (in squares, as in Codim-IPC). c [m/s²] is a constant, so that the acceleration by which
cloth is pushed off depends neither on its density (the gauge (ρ, κ_s, κ_b) → c(ρ, κ_s, κ_b) is exact) nor on the mesh.
`cipc_stiffness` gives the rule of the original instead: one stiffness from the mean nodal mass, no area, no time step.

Source: Li et al. 2020 (IPC), eq. 6; area weights of Li et al. 2023 (convergent IPC), without its inclusion-exclusion, which would give some
pairs negative weight: a contact over the common edge of two faces counts for both. Values and derivatives by ipctk.
"""

from dataclasses import dataclass

import ipctk
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from typing_extensions import override

from tasks.simulator.contact_surface import ContactSurface
from tasks.simulator.potential import Potential, Step, StepTangent, sparse_times

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ContactBarrier(Potential):
    """Barrier on a contact surface; `stiffness` multiplies −(d² − d̂²)² ln(d²/d̂²) · a;  time_free: C-IPC adds the barrier without its h²."""

    surface: ContactSurface
    stiffness: float
    time_free: bool = False
    parameters = ("log_density",)

    @override
    def energy(self, x: Array, step: Step) -> float:
        X = self.surface.join(x, step.collider)
        pairs = self.surface.pairs(X)
        if not len(pairs):
            return 0.0
        return self.scale(step) * self.barrier(pairs, self.surface.mesh, X)

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        X = self.surface.join(x, step.collider)
        pairs = self.surface.pairs(X)
        if not len(pairs):
            return np.zeros_like(x)
        return self.scale(step) * self.barrier.gradient(pairs, self.surface.mesh, X).reshape(-1, 3)[: len(x)]

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> csc_matrix:
        X = self.surface.join(x, step.collider)
        pairs = self.surface.pairs(X)
        if not len(pairs):
            return csc_matrix((X.size, X.size))
        kind = ipctk.PSDProjectionMethod.CLAMP if convex else ipctk.PSDProjectionMethod.NONE
        H = self.barrier.hessian(pairs, self.surface.mesh, X, kind)
        H.data *= self.scale(step)
        return H

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        if name != "log_density":
            raise KeyError(name)
        return self.gradient(x, step)

    @override
    def history_gradient(self, x: Array, step: Step, d: StepTangent) -> Array | None:
        if not d.collider.any():
            return None
        H, out = self.hessian(x, step, convex=False), np.zeros_like(d.x_n)
        out[-len(d.collider) :] = sparse_times(H[: x.size, x.size :], d.collider)
        return out

    @property
    def barrier(self) -> ipctk.BarrierPotential:
        """The potential as ipctk knows it."""
        return ipctk.BarrierPotential(self.surface.barrier_distance, self.stiffness)

    def scale(self, step: Step) -> float:
        """1, or 1/s² where the barrier was meant for the potential multiplied by s²."""
        return 1 / step.s**2 if self.time_free else 1.0


def stiffness(areal_density: float, *, acceleration: float, barrier_distance: float, offset: float) -> float:
    """κ/D̂² [J/m⁶] with D̂ = d̂² + 2 d̂·offset, the squared distance at which the barrier begins; acceleration c [m/s²]."""
    D = barrier_distance**2 + 2 * barrier_distance * offset
    return areal_density * acceleration * barrier_distance / D**2


def cipc_stiffness(mean_nodal_mass: float, barrier_distance: float) -> float:
    """Barrier stiffness of C-IPC: 3e11 m̄ / (4e-16 b''(1e-16)), b'' of the squared distance."""
    D, d = barrier_distance**2, 1e-16
    curvature = -2 * np.log(d / D) - 4 * (d - D) / d + ((d - D) / d) ** 2
    return 3e11 * mean_nodal_mass / (4e-16 * curvature)
