"""Quadratic air drag across the cloth.

    D = Σ_faces ⅙ ρ_a C_d A |v·n|³  [W],   force −½ ρ_a C_d A |v·n| (v·n) n

v: mean velocity of the corners; n, A: normal and area of the face at the start of the step (lagged).
Strength: C_d/ρ̄ [m²/kg] (ρ_a = 1.2 kg/m³ is known, ρ̄ is not). Range: C_d 0.5–2, a plate has 1.2, at ρ̄ 0.08–0.35 kg/m².
Signature: normal to the cloth, on free panels and hems, grows with the square of the speed, odd harmonics.
Confounders: air_linear_drag, fabric_mass_damping, air_tangential_drag; two speeds and edge-on motion tell them apart.
Source: Coltraro et al. 2023; Bridson, Marino, Fedkiw 2003 (per triangle). Limits: still air; no added mass; no shelter of one layer by
another.
"""

from collections.abc import Sequence

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.effects.faces_in_air import AIR_DENSITY, PlatesTerm, across, outer, turn_across
from tasks.simulator.potential import Array, Potential


class NormalDrag(PlatesTerm):
    """φ = ⅙ ρ_a |v·n|³."""

    @override
    def density(self, r: Array, n: Array) -> Array:
        return AIR_DENSITY / 6 * np.abs(across(r, n)) ** 3

    @override
    def slope(self, r: Array, n: Array) -> Array:
        u = across(r, n)
        return (AIR_DENSITY / 2 * np.abs(u) * u)[:, None] * n

    @override
    def curvature(self, r: Array, n: Array, *, convex: bool) -> Array:
        return outer(AIR_DENSITY * np.abs(across(r, n)), n)

    @override
    def turn(self, r: Array, n: Array) -> Array:
        u = across(r, n)
        return turn_across(r, n, AIR_DENSITY / 2 * np.abs(u) * u, AIR_DENSITY * np.abs(u))


class AirNormalDrag(Effect):
    """Quadratic drag across the cloth."""

    name = "air_normal_drag"
    kind = "potential"
    strengths = (Strength("C_d/ρ̄", "m2/kg", 8.0, 0.0, 25.0),)
    keeps = frozenset({"rest", "statics", "energy", "gauge"})
    confused_with = frozenset(
        {"air_linear_drag", "air_tangential_drag", "fabric_mass_damping", "air_wind", "air_lift", "observation_smoothing"}
    )

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (NormalDrag(subject, self.name, θ[0]),)


EFFECT = AirNormalDrag()
