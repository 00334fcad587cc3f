"""A vertical that is not vertical: the recording's calibration leans, so gravity does in its coordinates.

    P = −Σ m δg·x,   δg = g (u/|u| − ĝ),   u = ĝ + θ × ĝ,   θ = (θ_x, 0, θ_z)

Strengths: θ_x, θ_z [rad], turns of gravity about the horizontal axes (tangents of the angles, the same to 0.1 % at 3°).
Range: 0.1–2° by a level or markers, to 5° by eye; typical 0.03.
Signature: everything leans one way, in motion and at rest, edge-on panels as well.
Confounders: air_wind (measured |cos| 0.30: it spares panels edge-on).
Source: rigid turn of the field. Limits: the same at all times and places; standard gravity.
"""

from collections.abc import Sequence

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.simulator.gravity import STANDARD
from tasks.simulator.potential import NO_STIFFNESS, Array, Blocks, Potential, Step

AXES = {"gravity_tilt.θ_x": np.array([1.0, 0, 0]), "gravity_tilt.θ_z": np.array([0, 0, 1.0])}


class Tilt(Potential):
    """Weight of nodal masses [V] kg in the difference of the leaning field to the upright one."""

    parameters = (*AXES, "log_density")

    def __init__(self, mass: Array, θ: Sequence[float]) -> None:
        self.mass, self.θ = mass, dict(zip(AXES, θ, strict=True))
        g = np.array(STANDARD)
        lean = sum(t * np.cross(axis, g) for t, axis in zip(θ, AXES.values(), strict=True))
        self.field, self.stretch = g + lean, float(np.sqrt(1 + sum(t * t for t in θ)))
        self.δg = self.field / self.stretch - g

    @override
    def energy(self, x: Array, step: Step) -> float:
        return -float(self.mass @ (x @ self.δg)) if self.δg.any() else 0.0

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return -self.mass[:, None] * self.δg

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        return NO_STIFFNESS

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        if name == "log_density":
            return self.gradient(x, step)
        slope = np.cross(AXES[name], STANDARD) / self.stretch - self.θ[name] * self.field / self.stretch**3
        return -self.mass[:, None] * slope


class GravityTilt(Effect):
    """Leaning gravity."""

    name = "gravity_tilt"
    kind = "potential"
    strengths = (Strength("θ_x", "rad", 0.03, -0.09, 0.09), Strength("θ_z", "rad", 0.03, -0.09, 0.09))
    keeps = frozenset({"shape", "gauge"})
    confused_with = frozenset({"air_wind"})

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (Tilt(subject.fabric.areal_density * subject.cloth.vertex_areas, θ),)


EFFECT = GravityTilt()
