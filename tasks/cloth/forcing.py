"""Accelerations that nobody modelled: smooth over the cloth, constant through a window, other ones in every window.

    P = −Σ_i m_i a(X_i)·x_i,    a(X) = Σ_k a_k φ_k(X),    a_k ~ N(0, σ_a²) in each direction

φ: the lowest modes of `state_modes.py`. Whatever the model lacks accelerates cloth; so predictions are not trusted more than such an
acceleration allows, and σ_a, estimated from the data, says how much is missing. A cause that is right asks for one strength in all windows
where this asks for anything anywhere.

Source: weak-constraint assimilation (Trémolet 2006); a discrepancy of the model beside its parameters (Kennedy & O'Hagan 2001).
Limits: what jumps within a window, or is finer than the modes, is not in it.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.simulator.potential import NO_STIFFNESS, Blocks, Potential, Step

Array = NDArray[np.float64]

FORCED = 12  # modes


class SmoothForce(Potential):
    """The term at zero; its parameters are the accelerations' coefficients, mode by mode and axis by axis."""

    def __init__(self, mass: Array, φ: Array, names: Sequence[str]) -> None:
        self.mass, self.φ, self.parameters = mass, φ, tuple(names)
        self._place = {name: divmod(i, 3) for i, name in enumerate(self.parameters)}

    @override
    def energy(self, x: Array, step: Step) -> float:
        return 0.0

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return np.zeros_like(x)

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        return NO_STIFFNESS

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        mode, axis = self._place[name]
        slope = np.zeros_like(x)
        slope[:, axis] = -self.mass * self.φ[mode]
        return slope


class Forcing(Effect):
    """What a window may be accelerated by beyond the model: no suspect, but what every suspect is held against."""

    name = "forcing"
    kind = "force"

    def __init__(self, φ: Array) -> None:
        """φ [K, V]: modes, of which the first `FORCED` serve."""
        self.φ = φ[:FORCED]
        self.strengths = tuple(Strength(f"a {k} {axis}", "m/s2", 1.0, -np.inf, np.inf) for k in range(len(self.φ)) for axis in "xyz")

    @property
    @override
    def columns(self) -> tuple[str, ...]:
        return tuple(s.symbol for s in self.strengths)

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (SmoothForce(subject.fabric.areal_density * subject.cloth.vertex_areas, self.φ, self.columns),)
