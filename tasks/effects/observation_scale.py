"""Cameras whose metre is not a metre: garment, boundary and body are all e^s times too large.

In recorded metres, x_rec = e^s x about any point, the equations of the base model hold with

    rest lengths × e^s,      g × e^s,      hinge constants × e^{2s}, which are fitted anyway

so that the whole recording, its start included, stays as it is. A translation is no effect: the centre does not matter.
Strength: s = ln of the ratio of lengths [1]. Range: ±0.2–1 % after calibration with a board, to ±5 % by eye; typical 0.005.
Signature: static tension everywhere, and gravity that is too strong by s.
Confounders: fabric_rest_scale, the same but for gravity: in practice one class, unless the pattern is measured.
Source: similarity of the equations of motion. Limits: the rest shape is taken to be known in true metres (a pattern); where it comes from
the same cameras only gravity remains, and s is not testable.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Effect, MeshDoubt, Strength, Subject
from tasks.simulator import Fabric
from tasks.simulator.gravity import STANDARD
from tasks.simulator.potential import NO_STIFFNESS, Array, Blocks, Potential, Step


class StrongerGravity(Potential):
    """Weight of nodal masses [V] kg in (e^s − 1) g."""

    parameters = ("observation_scale", "log_density")

    def __init__(self, mass: Array, s: float) -> None:
        self.mass, self.share, self.rate = mass, float(np.expm1(s)), float(np.exp(s))

    @override
    def energy(self, x: Array, step: Step) -> float:
        return -self.share * float(self.mass @ (x @ np.array(STANDARD))) if self.share else 0.0

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return -self.share * self.mass[:, None] * np.array(STANDARD)

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        return NO_STIFFNESS

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        share = {"log_density": self.share, "observation_scale": self.rate}[name]
        return -share * self.mass[:, None] * np.array(STANDARD)


class ObservationScale(Effect):
    """A wrong unit of length."""

    name = "observation_scale"
    kind = "observation"
    strengths = (Strength("s", "1", 0.005, -0.05, 0.05),)
    keeps = frozenset({"gauge"})
    confused_with = frozenset({"fabric_rest_scale"})

    @property
    @override
    def parameters(self) -> dict[str, tuple[str, ...]]:
        return {self.name: ("log_rest_scale", self.name)}

    @override
    def fabric(self, fabric: Fabric, θ: Sequence[float]) -> Fabric:
        return replace(fabric, rest_scale=fabric.rest_scale * float(np.exp(θ[0])))

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (StrongerGravity(subject.fabric.areal_density * subject.cloth.vertex_areas, θ[0]),)

    @override
    def feigned(self, doubt: MeshDoubt) -> Array:
        return np.array([doubt.scale])


EFFECT = ObservationScale()
