"""The same with another law of the fold: 2 sin(θ/2) in place of the angle θ.

    P = Σ 3k|ē|²/(Ā₁ + Ā₂) [(2 sin θ/2 − 2 sin θ̄/2)² − (θ − θ̄)²]        beside the base's

Both are the same where cloth is nearly flat; at a fold of 90° the moment of the sine is a third less. Nobody knows the law of a fabric
there.

Strength: 1 is the other law [1]. Range: 0–1.
Signature: sharp folds, and tubes that are bent or flattened.
Confounders: fabric_rest_curvature, fabric_bending_hysteresis; it is integrated out, never named.
Source: Bridson, Marino, Fedkiw 2003 (the sine); `simulator.hinge_bending`. Limits: softens beyond 90°.
"""

from collections.abc import Sequence

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.effects.fold_moments import fold_force, fold_stiffness
from tasks.simulator.hinge_bending import HingeBending, angle_gradients, angles
from tasks.simulator.potential import NO_STIFFNESS, Array, Blocks, Potential, Step


class SineBending(Potential):
    """Share s of the difference between the two laws."""

    parameters = ("numerics_bending", "log_bending")

    def __init__(self, subject: Subject, share: float) -> None:
        base = HingeBending.of(subject.cloth, subject.fabric)
        self.hinges, self.weight, self.rest, self.share = base.hinges, base.weight, base.rest_angle, share

    @override
    def energy(self, x: Array, step: Step) -> float:
        if not self.share:
            return 0.0
        θ = angles(x, self.hinges)
        return self.share * float(self.weight @ ((_sine(θ) - _sine(self.rest)) ** 2 - (θ - self.rest) ** 2))

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return self.share * self._force(x) if self.share else np.zeros_like(x)

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        if not self.share or convex:
            return NO_STIFFNESS
        θ, g = angles(x, self.hinges), angle_gradients(x, self.hinges).reshape(-1, 12)
        slope = 2 * self.share * self.weight * (np.cos(θ / 2) ** 2 - (_sine(θ) - _sine(self.rest)) * np.sin(θ / 2) / 2 - 1)
        turning = fold_stiffness(x, self.hinges, self.share * self._moment(θ), convex=False)
        outer = slope[:, None, None] * g[:, :, None] * g[:, None, :]
        return Blocks(self.hinges, outer if turning is NO_STIFFNESS else outer + turning.values)

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        return self.gradient(x, step) if name == "log_bending" else self._force(x)

    def _force(self, x: Array) -> Array:
        """∂P/∂x [V, 3] N of the whole difference."""
        return fold_force(x, self.hinges, self._moment(angles(x, self.hinges)))

    def _moment(self, θ: Array) -> Array:
        """∂P/∂θ [H] N·m of the whole difference."""
        return 2 * self.weight * ((_sine(θ) - _sine(self.rest)) * np.cos(θ / 2) - (θ - self.rest))


def _sine(θ: Array) -> Array:
    return 2 * np.sin(θ / 2)


class NumericsBending(Effect):
    """The other law of the fold."""

    name = "numerics_bending"
    kind = "potential"
    strengths = (Strength("share", "1", 1.0, 0.0, 1.0),)
    keeps = frozenset({"momentum", "gauge"})

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (SineBending(subject, θ[0]),)


EFFECT = NumericsBending()
