"""Damping in proportion to mass: every vertex is braked as if it moved through syrup.

    D = ½ α Σ m |v|²  [W],   force −α m v

Strength: α [1/s]. Range: 0–2 1/s.
Signature: all vertices alike, rigid translation included; brakes free fall, which no force within cloth can do.
Confounders: air_normal_drag (measured |cos| 0.86), air_tangential_drag (0.81); air_linear_drag is the same for face-on motion of uniform
cloth, α = c/ρ̄; air_added_mass out of phase. Edge-on against face-on motion, two speeds.
Source: Rayleigh's mass-proportional damping; several cloth engines produce it by accident. Limits: no physical law: it violates
Galilean invariance, and stands for whatever brakes everything, the engine that made a simulated recording included.
"""

from collections.abc import Sequence

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.simulator.potential import NO_STIFFNESS, Array, Blocks, Potential, Step, StepTangent


class MassDamping(Potential):
    """Nodal masses [V] kg braked at the rate α [1/s]."""

    parameters = ("fabric_mass_damping", "log_density")

    def __init__(self, mass: Array, α: float) -> None:
        self.mass, self.α = mass, α
        self._vertices = np.arange(len(mass), dtype=np.int32)[:, None]

    @override
    def energy(self, x: Array, step: Step) -> float:
        return 0.5 * self.α * step.s * float(self.mass @ np.sum(step.velocity(x) ** 2, 1)) if self.α else 0.0

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return self.α * self.mass[:, None] * step.velocity(x) if self.α else np.zeros_like(x)

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        return Blocks(self._vertices, (self.α / step.s * self.mass)[:, None, None] * np.eye(3)) if self.α else NO_STIFFNESS

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        if name not in self.parameters:
            raise KeyError(name)
        return self.mass[:, None] * step.velocity(x) if name == "fabric_mass_damping" else self.gradient(x, step)

    @override
    def history_gradient(self, x: Array, step: Step, d: StepTangent) -> Array | None:
        return -self.α / step.s * self.mass[:, None] * d.x_hat if self.α else None


class FabricMassDamping(Effect):
    """Damping in proportion to mass."""

    name = "fabric_mass_damping"
    kind = "potential"
    strengths = (Strength("α", "1/s", 0.5, 0.0, 3.0),)
    keeps = frozenset({"rest", "statics", "energy", "gauge"})
    confused_with = frozenset({"air_normal_drag", "air_tangential_drag", "air_linear_drag"})

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (MassDamping(subject.fabric.areal_density * subject.cloth.vertex_areas, θ[0]),)


EFFECT = FabricMassDamping()
