"""Mass that the base model does not know of: inertia and weight of further nodal masses."""

import numpy as np
from typing_extensions import override

from tasks.simulator.gravity import STANDARD
from tasks.simulator.potential import NO_STIFFNESS, Array, Blocks, Potential, Step, StepTangent


class FurtherMass(Potential):
    """P = strength Σ m (½ |x − x̃|²/s² − g·x) for nodal masses m [V] kg, which may be negative where there is less than thought."""

    def __init__(self, name: str, mass: Array, strength: float) -> None:
        """The parameter `name` is the factor before the masses."""
        self.parameters = (name, "log_density")
        self.mass, self.strength = mass, strength
        self._vertices = np.arange(len(mass), dtype=np.int32)[:, None]

    @override
    def energy(self, x: Array, step: Step) -> float:
        if not self.strength:
            return 0.0
        inertia = np.sum((x - step.x_tilde) ** 2, 1) / (2 * step.s**2)
        return self.strength * float(self.mass @ (inertia - x @ np.array(STANDARD)))

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return self.strength * self._unit(x, step) if self.strength else np.zeros_like(x)

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        if not self.strength:
            return NO_STIFFNESS
        mass = self.strength / step.s**2 * self.mass
        return Blocks(self._vertices, (np.maximum(mass, 0) if convex else mass)[:, None, None] * np.eye(3))

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        if name not in self.parameters:
            raise KeyError(name)
        return self.gradient(x, step) if name == "log_density" else self._unit(x, step)

    @override
    def history_gradient(self, x: Array, step: Step, d: StepTangent) -> Array | None:
        if not self.strength:
            return None
        return -self.strength / step.s**2 * self.mass[:, None] * (d.x_hat + step.s * d.v_hat)

    def _unit(self, x: Array, step: Step) -> Array:
        return self.mass[:, None] * ((x - step.x_tilde) / step.s**2 - np.array(STANDARD))
