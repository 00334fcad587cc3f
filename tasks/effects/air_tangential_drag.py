"""Quadratic air drag along the cloth: skin friction.

    D = Σ_faces ⅙ ρ_a C_t A |v_t|³  [W],   v_t = v − (v·n) n,   force −½ ρ_a C_t A |v_t| v_t

v: mean velocity of the corners; n, A: normal and area of the face at the start of the step (lagged).
Strength: C_t/ρ̄ [m²/kg]. Range: C_t 0.005 (smooth plate) to 0.3 (pile, ruffles), both sides together, at ρ̄ 0.08–0.35 kg/m².
Signature: along the cloth, where it moves edge-on; grows with the square of the speed; nothing where it moves face-on.
Confounders: fabric_mass_damping, air_normal_drag (measured |cos| 0.81 and 0.43 on a swinging panel); face-on against edge-on motion.
Source: Schlichting & Gersten, Boundary-Layer Theory (plates); Ling, Damodaran, Gay 1996 (cloth). Limits: still air; one coefficient for
both directions of the weave.
"""

from collections.abc import Sequence

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.effects.faces_in_air import AIR_DENSITY, PlatesTerm, across
from tasks.simulator.potential import Array, Potential

SLOWEST = 1e-12  # [m/s], against division by zero


class TangentialDrag(PlatesTerm):
    """φ = ⅙ ρ_a |v_t|³."""

    @override
    def density(self, r: Array, n: Array) -> Array:
        return AIR_DENSITY / 6 * _along(r, n)[1] ** 3

    @override
    def slope(self, r: Array, n: Array) -> Array:
        v, speed = _along(r, n)
        return AIR_DENSITY / 2 * speed[:, None] * v

    @override
    def curvature(self, r: Array, n: Array, *, convex: bool) -> Array:
        v, speed = _along(r, n)
        plane = np.eye(3) - np.einsum("fi,fj->fij", n, n)
        return AIR_DENSITY / 2 * (speed[:, None, None] * plane + np.einsum("f,fi,fj->fij", 1 / speed, v, v))

    @override
    def turn(self, r: Array, n: Array) -> Array:
        v, speed = _along(r, n)
        dv = -np.einsum("fi,fj->fij", n, r) - across(r, n)[:, None, None] * np.eye(3)
        return AIR_DENSITY / 2 * (speed[:, None, None] * dv + np.einsum("f,fi,fk,fkj->fij", 1 / speed, v, v, dv))


def _along(r: Array, n: Array) -> tuple[Array, Array]:
    """v_t [F, 3] and its length [F]."""
    v = r - across(r, n)[:, None] * n
    return v, np.maximum(np.linalg.norm(v, axis=1), SLOWEST)


class AirTangentialDrag(Effect):
    """Quadratic drag along the cloth."""

    name = "air_tangential_drag"
    kind = "potential"
    strengths = (Strength("C_t/ρ̄", "m2/kg", 0.7, 0.0, 4.0),)
    keeps = frozenset({"rest", "statics", "energy", "gauge"})
    confused_with = frozenset({"air_normal_drag", "fabric_mass_damping", "fabric_membrane_damping"})

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (TangentialDrag(subject, self.name, θ[0]),)


EFFECT = AirTangentialDrag()
