"""A steady horizontal wind or room draught w: the drag of air that moves, less the drag of air that does not.

    D = Σ_faces A [ψ(v·n − w·n) − ψ(v·n)]  [W],   ψ(u) = ⅙ ρ_a C_d (u² + ε²)^{3/2},   ψ′(u) = ½ ρ_a C_d √(u² + ε²) u

The drag of still air is air_normal_drag's: the difference makes w = 0 the base model exactly, and both effects together the drag with v
− w. C_d/ρ̄ is held at 8 m²/kg (C_d = 1.2 at 0.15 kg/m²): without it w and C_d could not be told apart. ε = 0.2 m/s, how much a draught of
0.5 m/s fluctuates (turbulence intensity 40 %), makes the force on cloth at rest start linearly in w (½ ρ_a C_d A ε w·n), so that the
tangent at w = 0 sees it.
n, A: normal and area of the face at the start of the step (lagged).
Strengths: w_x, w_z [m/s]. Range: draughts of rooms to 0.5 m/s, fans to 2 m/s.
Signature: a steady lean of everything that faces the wind, in one direction; on moving cloth also a force ρ_a C_d |v·n| w·n.
Confounders: gravity_tilt (acts on panels edge-on as well), fabric_rest_curvature, air_normal_drag; panels face-on and edge-on tell.
Source: Bridson, Marino, Fedkiw 2003 (drag with v − w); ISO 7730 (draughts and their fluctuation). Limits: the same everywhere and at
all times; no vertical part (the warm air that rises along a body has one); no shelter by the body.
"""

from collections.abc import Sequence

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.effects.faces_in_air import AIR_DENSITY, PlatesTerm, across, outer, turn_across
from tasks.simulator.potential import Array, Potential, Step

DRAG_AREA = 8.0  # C_d/ρ̄ [m²/kg]
FLUCTUATION = 0.2  # ε [m/s]
DIRECTIONS = {"air_wind.w_x": np.array([1.0, 0, 0]), "air_wind.w_z": np.array([0, 0, 1.0])}


class Wind(PlatesTerm):
    """φ = ψ(v·n − w·n) − ψ(v·n) for a wind w [3] m/s."""

    def __init__(self, subject: Subject, w: Array) -> None:
        super().__init__(subject, "air_wind", DRAG_AREA)
        self.w = w
        self.parameters = (*DIRECTIONS, "log_density")

    @property
    @override
    def idle(self) -> bool:
        return not self.w.any()

    @override
    def density(self, r: Array, n: Array) -> Array:
        u, relative = self._speeds(r, n)
        return AIR_DENSITY / 6 * (_speed(relative) ** 3 - _speed(u) ** 3)

    @override
    def slope(self, r: Array, n: Array) -> Array:
        return self._push(*self._speeds(r, n))[:, None] * n

    @override
    def curvature(self, r: Array, n: Array, *, convex: bool) -> Array:
        u, relative = self._speeds(r, n)
        c = _stiffness(relative) - _stiffness(u)
        return outer(np.maximum(c, 0) if convex else c, n)

    @override
    def turn(self, r: Array, n: Array) -> Array:
        u, relative = self._speeds(r, n)
        of_wind = turn_across(r - self.w, n, self._push(u, relative), _stiffness(relative))
        return of_wind - np.einsum("f,fi,fj->fij", _stiffness(u), n, r)

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        if name not in DIRECTIONS:
            return super().parameter_gradient(name, x, step)
        r, n, mass = self._motion(x, step)
        _, relative = self._speeds(r, n)
        return self.air.to_corners((-self.strength * mass * _stiffness(relative) * (n @ DIRECTIONS[name]))[:, None] * n)

    def _speeds(self, r: Array, n: Array) -> tuple[Array, Array]:
        """Normal speed in still air and in the wind [F] m/s."""
        u = across(r, n)
        return u, u - n @ self.w

    def _push(self, u: Array, relative: Array) -> Array:
        return AIR_DENSITY / 2 * (_speed(relative) * relative - _speed(u) * u)


def _speed(u: Array) -> Array:
    """√(u² + ε²)."""
    return np.sqrt(u**2 + FLUCTUATION**2)


def _stiffness(u: Array) -> Array:
    """½ ρ_a d(√(u² + ε²) u)/du."""
    return AIR_DENSITY / 2 * (2 * u**2 + FLUCTUATION**2) / _speed(u)


class AirWind(Effect):
    """A steady horizontal wind."""

    name = "air_wind"
    kind = "potential"
    strengths = (Strength("w_x", "m/s", 0.3, -2.0, 2.0), Strength("w_z", "m/s", 0.3, -2.0, 2.0))
    keeps = frozenset({"gauge"})
    confused_with = frozenset({"gravity_tilt", "fabric_rest_curvature", "air_normal_drag", "air_lift"})

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (Wind(subject, np.array([θ[0], 0.0, θ[1]])),)


EFFECT = AirWind()
