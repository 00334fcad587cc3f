"""Lift: air force across the direction of motion of cloth that moves at a slant.

    f = −½ ρ_a C_l A (v·n) (|v| n − (v·n) v/|v|)  [N],   |f| = ½ ρ_a C_l A |v|² sin α cos α,   f·v = 0

α: angle between the face and its velocity v (mean of the corners). It has no potential and enters lagged: f at x_n, v_n.
Strength: C_l/ρ̄ [m²/kg]. Range: C_l 0.1–1.2 (a plate at 45° has about 1, half of the coefficient here) at ρ̄ 0.08–0.35 kg/m².
Signature: across the motion, where a panel moves at a slant; tilts the plane of a swing; nothing face-on or edge-on.
Confounders: air_normal_drag (along n as well, but it brakes), air_wind; motion at several slants tells.
Source: Wejchert & Haumann 1991; Ling, Damodaran, Gay 1996; Mao et al. (real cloth prefers drag with lift). Limits: still air; one step
late, so that it does a little work; no stall.
"""

from collections.abc import Sequence

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.effects.faces_in_air import AIR_DENSITY, FacesInAir, across
from tasks.simulator.potential import NO_STIFFNESS, Array, Blocks, Potential, Step, StepTangent

SLOWEST = 1e-12  # [m/s], against division by zero


class Lift(Potential):
    """P = −f·x with f of the step's start."""

    parameters = ("air_lift", "log_density")

    def __init__(self, subject: Subject, strength: float) -> None:
        cloth = subject.cloth
        self.air, self.strength, self.areal_density = FacesInAir(cloth.faces, len(cloth.x_rest)), strength, subject.fabric.areal_density

    @override
    def energy(self, x: Array, step: Step) -> float:
        return float(np.sum(self.gradient(x, step) * x)) if self.strength else 0.0

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return self.strength * self._unit(step) if self.strength else np.zeros_like(x)

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        return NO_STIFFNESS

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        if name not in self.parameters:
            raise KeyError(name)
        return self._unit(step) if name == "air_lift" else self.gradient(x, step)

    @override
    def history_gradient(self, x: Array, step: Step, d: StepTangent) -> Array | None:
        if not self.strength:
            return None
        v, n, u, speed, weight = self._motion(step)
        vv, vn = np.einsum("fi,fj->fij", v, v), np.einsum("fi,fj->fij", v, n)
        u, speed, eye = u[:, None, None], speed[:, None, None], np.eye(3)
        slanted = speed * n[:, :, None] - u / speed * v[:, :, None]
        by_normal = slanted * v[:, None] + u * (speed * eye - vv / speed)
        by_velocity = slanted * n[:, None] + u / speed * (vn.transpose(0, 2, 1) - vn + u / speed**2 * vv - u * eye)
        weight = self.strength * weight[:, None, None]
        df = self.air.turned(step.x_n, d.x_n, (weight * u * slanted)[:, :, 0], weight * by_normal)
        return self.air.to_corners(df + self.air.carried(d.v_n, weight * by_velocity))

    def _unit(self, step: Step) -> Array:
        """−f [V, 3] at strength one."""
        v, n, u, speed, weight = self._motion(step)
        return self.air.to_corners((weight * u)[:, None] * (speed[:, None] * n - (u / speed)[:, None] * v))

    def _motion(self, step: Step) -> tuple[Array, Array, Array, Array, Array]:
        """v, n [F, 3], v·n, |v| [F], and ½ ρ_a ρ̄ A [F]."""
        n, A = self.air.normals(step.x_n)
        v = self.air.mean(step.v_n)
        speed = np.maximum(np.linalg.norm(v, axis=1), SLOWEST)
        return v, n, across(v, n), speed, AIR_DENSITY / 2 * self.areal_density * A


class AirLift(Effect):
    """Lift of cloth that moves at a slant."""

    name = "air_lift"
    kind = "force"
    strengths = (Strength("C_l/ρ̄", "m2/kg", 4.0, 0.0, 15.0),)
    keeps = frozenset({"rest", "statics", "gauge"})
    confused_with = frozenset({"air_normal_drag", "air_wind"})

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (Lift(subject, θ[0]),)


EFFECT = AirLift()
