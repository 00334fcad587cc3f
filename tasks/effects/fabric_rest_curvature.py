"""Cloth that curls by itself: finishes, knit structure, one face shrunk more than the other.

    θ̄ = base + [κ₀ + Δκ (n_u² − n_v²)] (Ā₁ + Ā₂)/|ē|        P = −2 Σ 3k|ē|²/(Ā₁ + Ā₂) (θ̄ − base) θ

n: direction across the edge in the pattern. The moment is that of the curvature tensor diag(κ₀ + Δκ, κ₀ − Δκ) in (weft, warp) whatever
the mesh, as Σ θ|ē| n nᵀ is the integral of the curvature. The constant of the square is left out: it moves nothing.
Strengths: κ₀, mean, and Δκ, weft over warp [1/m]; positive bulges towards the normals of the faces, so that edges curl away from them.
Range: ±20 1/m; typical 8.
Signature: static; borders curl in one direction; the same at all speeds.
Confounders: bending stiffness at one pose, air_wind, fabric_bending_hysteresis, fabric_crease (after an event only), fabric_seam_stiffness.
Source: `simulator.hinge_bending`; Cohen-Steiner & Morvan 2003 for the tensor. Limits: the same all over the garment; without a
pattern Δκ is nothing.
"""

from collections.abc import Sequence

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.effects.fold_moments import fold_force, fold_stiffness
from tasks.effects.pattern_edges import edges_in_pattern, hinge_spans
from tasks.simulator import Cloth
from tasks.simulator.hinge_bending import HingeBending, angles
from tasks.simulator.potential import NO_STIFFNESS, Array, Blocks, Potential, Step


class RestCurvature(Potential):
    """Fold moments of the hinges at curvatures (κ₀, Δκ) [1/m]."""

    parameters = ("fabric_rest_curvature.κ₀", "fabric_rest_curvature.Δκ", "log_bending")

    def __init__(self, subject: Subject, κ: Sequence[float]) -> None:
        base = HingeBending.of(subject.cloth, subject.fabric)
        self.hinges = base.hinges
        even = -2 * base.weight * hinge_spans(subject.cloth)
        self.units = dict(zip(self.parameters, (even, even * _weft_over_warp(subject.cloth)), strict=False))
        self.moment = sum(k * m for k, m in zip(κ, self.units.values(), strict=True))
        self.idle = not any(κ)

    @override
    def energy(self, x: Array, step: Step) -> float:
        return 0.0 if self.idle else float(self.moment @ angles(x, self.hinges))

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return np.zeros_like(x) if self.idle else fold_force(x, self.hinges, self.moment)

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        return NO_STIFFNESS if self.idle else fold_stiffness(x, self.hinges, self.moment, convex=convex)

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        return self.gradient(x, step) if name == "log_bending" else fold_force(x, self.hinges, self.units[name])


def _weft_over_warp(cloth: Cloth) -> Array:
    """n_u² − n_v² [H] of the direction n across each hinge; 0 without a pattern."""
    if cloth.uv is None:
        return np.zeros(len(cloth.hinges))
    sides = edges_in_pattern(cloth)
    along = sides[:, :, 1] - sides[:, :, 0]
    squares = along**2 / np.sum(along**2, 2, keepdims=True)
    return (squares[..., 1] - squares[..., 0]).mean(1)


class FabricRestCurvature(Effect):
    """Curling of its own accord."""

    name = "fabric_rest_curvature"
    kind = "potential"
    strengths = (Strength("κ₀", "1/m", 8.0, -20.0, 20.0), Strength("Δκ", "1/m", 8.0, -20.0, 20.0))
    keeps = frozenset({"momentum", "gauge"})
    confused_with = frozenset({"air_wind", "fabric_bending_hysteresis", "fabric_crease", "fabric_seam_stiffness"})

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (RestCurvature(subject, θ),)


EFFECT = FabricRestCurvature()
