"""Viscous damping of the membrane (Kelvin–Voigt): a stress in proportion to the rate of strain.

    P = ½ (β/h) Σ_faces Ā ΔEᵀ 𝔻 ΔE,   ΔE = E(x) − E(x_n),   stress β 𝔻 ΔE/h

with the Green strain E and the stiffness 𝔻 of the base model's membrane: strain rates, not velocities, so that turning cloth is free.
Strength: β [s]. Range: 1e-4–1e-2 s.
Signature: stretching and shearing dies away, high frequencies and short waves first; after jerks and impacts.
Confounders: numerics_time_step and numerics_integrator (backward Euler has β = h of its own), air_tangential_drag (measured |cos| 0.54),
fabric_shear_hysteresis (half the rate leaves hysteresis as it is and halves this).
Source: Bonet & Wood; Rayleigh's stiffness-proportional damping with the strain instead of the displacement. Limits: one β for all strains.
Under BDF2 the rate is half a step late, which takes (βh/2) 𝔻 off the inertia against deformation.
"""

from collections.abc import Sequence
from typing import Self

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.effects.stencil_levers import forces, lever, rates, strain_slopes
from tasks.simulator import strain
from tasks.simulator.membrane_stvk import MembraneStVK
from tasks.simulator.potential import NO_STIFFNESS, Array, Blocks, Potential, Step, StepTangent


class MembraneDamping(Potential):
    """A membrane whose rest strain is that of the step's start and whose stiffness is β/h times that of `membrane`."""

    parameters = ("fabric_membrane_damping", "log_membrane", "log_rest_scale", "orthotropy")

    def __init__(self, membrane: MembraneStVK, β: float) -> None:
        self.membrane, self.β = membrane, β

    @classmethod
    def of(cls, subject: Subject, β: float) -> Self:
        """β [s] times the base model's membrane."""
        return cls(MembraneStVK.of(subject.cloth, subject.fabric), β)

    @override
    def energy(self, x: Array, step: Step) -> float:
        if not self.β:
            return 0.0
        ΔE, m = self._change(x, step), self.membrane
        return self.β / step.h * 0.5 * float(m.area @ np.einsum("fi,fij,fj->f", ΔE, m.D, ΔE))

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return self.β * self._unit(x, step, self.membrane.D) if self.β else np.zeros_like(x)

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        if not self.β:
            return NO_STIFFNESS
        m, rate = self.membrane, self.β / step.h
        S = rate * _apply(m.D, self._change(x, step))
        return Blocks(m.faces, strain.hessian(x, m.faces, m.N, m.area, S, rate * m.D, convex))

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        return {
            "fabric_membrane_damping": lambda: self._unit(x, step, self.membrane.D),
            "log_membrane": lambda: self.gradient(x, step),
            "log_rest_scale": lambda: -2 * self.gradient(x, step),  # Ā ~ c², ΔE ~ c⁻², twice
            "orthotropy": lambda: self.β * self._unit(x, step, self.membrane.D_orthotropy),
        }[name]()

    @override
    def history_gradient(self, x: Array, step: Step, d: StepTangent) -> Array | None:
        if not self.β:
            return None
        m, strains = self.membrane, np.repeat(self.membrane.faces, 3, axis=0)
        before = np.einsum("fij,fjpk->fipk", self.β / step.h * m.area[:, None, None] * m.D, strain_slopes(step.x_n, m.faces, m.N))
        now = strain_slopes(x, m.faces, m.N)
        stress = rates(lever(strains, before.reshape(-1, 3, 3), len(x)), d.x_n)
        return -forces(lever(strains, now.reshape(-1, 3, 3), len(x)), stress)

    def _unit(self, x: Array, step: Step, D: Array) -> Array:
        """∂P/∂x [V, 3] at β = 1 s."""
        m = self.membrane
        return strain.gradient(x, m.faces, m.N, m.area, _apply(D, self._change(x, step) / step.h))

    def _change(self, x: Array, step: Step) -> Array:
        """ΔE [F, 3] = (ΔE₁₁, ΔE₂₂, 2ΔE₁₂)."""
        m = self.membrane
        return (strain.metric(x, m.faces, m.N) - strain.metric(step.x_n, m.faces, m.N)) * (0.5, 0.5, 1.0)


def _apply(D: Array, E: Array) -> Array:
    return np.einsum("fij,fj->fi", D, E)


class FabricMembraneDamping(Effect):
    """Kelvin–Voigt damping of stretch and shear."""

    name = "fabric_membrane_damping"
    kind = "potential"
    strengths = (Strength("β_m", "s", 3e-3, 0.0, 2e-2),)
    keeps = frozenset({"rest", "statics", "momentum", "energy", "gauge"})
    confused_with = frozenset({"air_tangential_drag", "fabric_shear_hysteresis", "observation_smoothing"})

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (MembraneDamping.of(subject, θ[0]),)


EFFECT = FabricMembraneDamping()
