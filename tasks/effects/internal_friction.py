"""Friction within the fabric, with a memory: a rate-independent moment that follows deformation up to a limit (Dahl's model).

    P = F Σ_k w_k ∫ z dq,   dz/dq = (1 − z sgn q̇)/c   ⇒   z = σ + (z_n − σ) e^{−|Δ|/c},   Δ = q(x) − q(x_n),   σ = sgn Δ
    ∫ z dq = σΔ + (z_n − σ) σ c (1 − e^{−|Δ|/c})

q_k: a deformation (hinge angle, shear), c_k: the deformation over which friction builds up, −1 < z < 1: the memory, F w_k: the greatest
moment. The integral over one step is an energy, convex in Δ, whose slope is z: the step stays a minimisation, and cloth that stops keeps
z, hence sticks. z moves on when a step is accepted, at strength zero as well, where the tangent is the moment at unit strength along the
base motion. Elastic for |Δ| ≪ c, Coulomb's law for |Δ| ≫ c.

Source: Dahl 1968; Miguel et al. 2013 (internal friction of cloth with it), Wong et al. 2013. Limits: the memory starts empty (z = 0).
"""

import numpy as np
from scipy.sparse import csc_matrix
from typing_extensions import override

from tasks.effects.stencil_levers import forces, rates
from tasks.simulator.potential import NO_STIFFNESS, Array, Blocks, Potential, Step, StepTangent


class InternalFriction(Potential):
    """Friction of strength F on deformations q [K], given by the three methods below, with weights w [K] and extents c [K]."""

    memory = ("z", "_dz")

    def __init__(self, name: str, strength: float, weight: Array, extent: Array) -> None:
        """The parameter `name` is F; the weights are understood to grow with the areal density."""
        self.parameters = (name, "log_density")
        self.strength, self.weight, self.extent = strength, weight, extent
        self.z = np.zeros_like(weight)
        self._dz: Array | None = None

    def deformation(self, x: Array) -> Array:
        """q [K] at x [V, 3]."""
        raise NotImplementedError

    def lever(self, x: Array) -> csc_matrix:
        """∂q/∂x transposed [3V, K]."""
        raise NotImplementedError

    def stiffness(self, x: Array, moment: Array, slope: Array, *, convex: bool) -> Blocks:
        """Σ slope ∂q ∂qᵀ + moment ∂²q for moments and slopes [K]; with `convex` a positive semi-definite neighbour."""
        raise NotImplementedError

    @override
    def begin(self, x: Array) -> None:
        self.z, self._dz = np.zeros_like(self.weight), None

    @override
    def accept(self, x: Array, step: Step) -> None:
        self.z = self._follow(x, step)[0]

    @override
    def accept_tangent(self, x: Array, step: Step, dx: Array, d: StepTangent, names: tuple[str, ...]) -> None:
        if self.strength:
            _, slope, kept = self._follow(x, step)
            dΔ = rates(self.lever(x), dx) - rates(self.lever(step.x_n), d.x_n)
            self._dz = slope * dΔ + (0.0 if self._dz is None else kept * self._dz)

    @override
    def energy(self, x: Array, step: Step) -> float:
        if not self.strength:
            return 0.0
        Δ = self._change(x, step)
        σ = np.sign(Δ)
        work = σ * Δ + (self.z - σ) * σ * self.extent * -np.expm1(-np.abs(Δ) / self.extent)
        return self.strength * float(self.weight @ work)

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return self.strength * self._unit(x, step) if self.strength else np.zeros_like(x)

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        if not self.strength:
            return NO_STIFFNESS
        z, slope, _ = self._follow(x, step)
        F = self.strength * self.weight
        return self.stiffness(x, F * z, F * slope, convex=convex)

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        if name not in self.parameters:
            raise KeyError(name)
        return self.gradient(x, step) if name == "log_density" else self._unit(x, step)

    @override
    def history_gradient(self, x: Array, step: Step, d: StepTangent) -> Array | None:
        if not self.strength:
            return None
        _, slope, kept = self._follow(x, step)
        dz = -slope * rates(self.lever(step.x_n), d.x_n) + (0.0 if self._dz is None else kept * self._dz)
        return forces(self.lever(x), self.strength * self.weight * dz)

    def _unit(self, x: Array, step: Step) -> Array:
        """∂P/∂x [V, 3] at strength one."""
        return forces(self.lever(x), self.weight * self._follow(x, step)[0])

    def _change(self, x: Array, step: Step) -> Array:
        """Δ [K]."""
        return self.deformation(x) - self.deformation(step.x_n)

    def _follow(self, x: Array, step: Step) -> tuple[Array, Array, Array]:
        """z at the end of the step and its derivatives in q and in z_n, each [K]."""
        Δ = self._change(x, step)
        σ = np.where(Δ < 0, -1.0, 1.0)
        kept = np.exp(-np.abs(Δ) / self.extent)
        return σ + (self.z - σ) * kept, (1 - σ * self.z) * kept / self.extent, kept
