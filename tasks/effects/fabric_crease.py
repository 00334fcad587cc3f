"""Creases: a fold beyond the yield curvature leaves part of itself behind.

    π ← π + sgn(φ)(|φ| − φ_y)₊  at the end of each step, φ = θ − θ̄ − π,      θ̄ → θ̄ + p π,
    φ_y = min(κ_y (Ā₁ + Ā₂)/|ē|, ½),   κ_y = 50 1/m

π is the fold angle beyond yield (a play operator: it holds when the fold opens and flows back when it is folded the other way), p the
share that stays. p = 1 is perfect plasticity. A yield curvature as the strength would have no tangent where there is no crease; the
share has one: the moment of the folds of the base motion. π begins at nothing and enters one step late.
Strength: p [1], 1 less the crease recovery angle over 180°. Range: recovery 90° (plain cotton) to 165° (wool), p 0.1–0.5.
Signature: a fold at one line after one event, which stays.
Confounders: fabric_bending_hysteresis (later cycles), fabric_rest_curvature (there from the start).
Source: Narain, Pfaff, O'Brien 2013 (rest angles that flow past yield); ISO 2313 (recovery angle). Limits: κ_y is fixed, at the lower end of
50–200 1/m; triangles too coarse for it yield at ½ rad; no weakening, no recovery in time; forgets what was before the motion begins.
"""

from collections.abc import Sequence

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.effects.fold_moments import fold_force, fold_stiffness
from tasks.effects.pattern_edges import hinge_spans
from tasks.effects.stencil_levers import lever, rates
from tasks.simulator.hinge_bending import HingeBending, angle_gradients, angles
from tasks.simulator.potential import NO_STIFFNESS, Array, Blocks, Potential, Step, StepTangent

YIELD_CURVATURE = 50.0  # κ_y [1/m]
YIELD_ANGLE = 0.5  # [rad], where the mesh is too coarse for κ_y


class Creases(Potential):
    """P = Σ w [(θ − θ̄ − pπ)² − (θ − θ̄)²] over the hinges of the base, w their weights."""

    parameters = ("fabric_crease", "log_bending")
    memory = ("π", "_dπ")

    def __init__(self, subject: Subject, share: float) -> None:
        self.base, self.share = HingeBending.of(subject.cloth, subject.fabric), share
        self.limit = np.minimum(YIELD_CURVATURE * hinge_spans(subject.cloth), YIELD_ANGLE)
        self.begin(subject.cloth.x_rest)

    @override
    def begin(self, x: Array) -> None:
        self.π, self._dπ = np.zeros_like(self.limit), None

    @override
    def accept(self, x: Array, step: Step) -> None:
        self.π = self.π + self._flow(x)

    @override
    def accept_tangent(self, x: Array, step: Step, dx: Array, d: StepTangent, names: tuple[str, ...]) -> None:
        if self.share:
            hinges = self.base.hinges
            dθ = rates(lever(hinges, angle_gradients(x, hinges), len(x)), dx)
            self._dπ = np.where(self._flow(x) != 0, dθ, 0.0 if self._dπ is None else self._dπ)

    @override
    def energy(self, x: Array, step: Step) -> float:
        if not self.share:
            return 0.0
        δ = self.share * self.π
        return float(self.base.weight @ (δ * (δ - 2 * self._fold(x))))

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return fold_force(x, self.base.hinges, self.share * self._unit) if self.share else np.zeros_like(x)

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        if not self.share:
            return NO_STIFFNESS
        return fold_stiffness(x, self.base.hinges, self.share * self._unit, convex=convex)

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        return self.gradient(x, step) if name == "log_bending" else fold_force(x, self.base.hinges, self._unit)

    @override
    def history_gradient(self, x: Array, step: Step, d: StepTangent) -> Array | None:
        if not self.share or self._dπ is None:
            return None
        return fold_force(x, self.base.hinges, -2 * self.share * self.base.weight * self._dπ)

    @property
    def _unit(self) -> Array:
        """Moments [H] at p = 1."""
        return -2 * self.base.weight * self.π

    def _fold(self, x: Array) -> Array:
        return angles(x, self.base.hinges) - self.base.rest_angle

    def _flow(self, x: Array) -> Array:
        """How far π [H] moves on."""
        φ = self._fold(x) - self.π
        return np.sign(φ) * np.maximum(np.abs(φ) - self.limit, 0)


class FabricCrease(Effect):
    """Folds that leave creases."""

    name = "fabric_crease"
    kind = "state"
    strengths = (Strength("p", "1", 0.3, 0.0, 1.0),)
    keeps = frozenset({"gauge"})
    confused_with = frozenset({"fabric_bending_hysteresis", "fabric_rest_curvature"})

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (Creases(subject, θ[0]),)


EFFECT = FabricCrease()
