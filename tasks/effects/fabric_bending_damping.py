"""Viscous damping of bending (Kelvin–Voigt): a moment in proportion to the rate of the hinge angle.

    P = (β/h) Σ_hinges k |ē|/h̄ (θ(x) − θ(x_n))²,   moment β · 2k |ē|/h̄ · Δθ/h

with the stiffness 2k|ē|/h̄ of the base model's hinges. Strength: β [s]. Range: 1e-3–1e-1 s.
Signature: flutter and travelling folds die away, faster than swinging does; slow drape stays.
Confounders: fabric_bending_hysteresis (measured |cos| 0.87): this doubles with the rate, that does not; air_added_mass and
air_linear_drag at one wavelength; numerics_time_step, as any damping of high frequencies.
Source: Bridson, Marino, Fedkiw 2003; Rayleigh's stiffness-proportional damping with angles instead of displacements.
Limits: the same β for all curvatures and directions. Under BDF2 the rate is half a step late. Angles between two
states of a step differ by less than π.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Self

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.effects.stencil_levers import forces, lever, rates
from tasks.simulator.hinge_bending import HingeBending, angle_gradients, angles
from tasks.simulator.potential import NO_STIFFNESS, Array, Blocks, Potential, Step, StepTangent


class BendingDamping(Potential):
    """Hinges whose rest angles are those of the step's start and whose weights are β/h times those of `bending`."""

    def __init__(self, bending: HingeBending, β: float) -> None:
        self.bending, self.β = bending, β
        self.parameters = ("fabric_bending_damping", *bending.parameters)

    @classmethod
    def of(cls, subject: Subject, β: float) -> Self:
        """β [s] times the base model's bending."""
        return cls(HingeBending.of(subject.cloth, subject.fabric), β)

    @override
    def energy(self, x: Array, step: Step) -> float:
        return self._hinges(step, self.β).energy(x, step) if self.β else 0.0

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return self._hinges(step, self.β).gradient(x, step) if self.β else np.zeros_like(x)

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        return self._hinges(step, self.β).hessian(x, step, convex=convex) if self.β else NO_STIFFNESS

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        if name not in self.parameters:
            raise KeyError(name)
        return self._hinges(step, 1.0).gradient(x, step) if name == "fabric_bending_damping" else self.gradient(x, step)

    @override
    def history_gradient(self, x: Array, step: Step, d: StepTangent) -> Array | None:
        if not self.β:
            return None
        hinges = self._hinges(step, self.β)
        before, now = (lever(hinges.hinges, angle_gradients(at, hinges.hinges), len(x)) for at in (step.x_n, x))
        return forces(now, -2 * hinges.weight * rates(before, d.x_n))

    def _hinges(self, step: Step, β: float) -> HingeBending:
        b = self.bending
        return replace(b, weight=β / step.h * b.weight, rest_angle=angles(step.x_n, b.hinges))


class FabricBendingDamping(Effect):
    """Kelvin–Voigt damping of bending."""

    name = "fabric_bending_damping"
    kind = "potential"
    strengths = (Strength("β_b", "s", 3e-2, 0.0, 2e-1),)
    keeps = frozenset({"rest", "statics", "momentum", "energy", "gauge"})
    confused_with = frozenset({"observation_smoothing", "fabric_bending_hysteresis"})

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (BendingDamping.of(subject, θ[0]),)


EFFECT = FabricBendingDamping()
