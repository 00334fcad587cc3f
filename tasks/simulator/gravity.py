"""Weight of the nodes:  P = −Σ m g·x  [J].  Limits: uniform field."""

from dataclasses import dataclass

import numpy as np
from typing_extensions import override

from tasks.simulator.potential import NO_STIFFNESS, Array, Blocks, Potential, Step

STANDARD = (0.0, -9.81, 0.0)  # [m/s²], y up


@dataclass(frozen=True)
class Gravity(Potential):
    """Nodal masses [V] kg and the field g [3] m/s²."""

    mass: Array
    g: tuple[float, float, float] = STANDARD
    parameters = ("log_density",)

    @override
    def energy(self, x: Array, step: Step) -> float:
        return -float(self.mass @ (x @ np.asarray(self.g)))

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return -self.mass[:, None] * np.asarray(self.g)

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        return NO_STIFFNESS

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        if name != "log_density":
            raise KeyError(name)
        return self.gradient(x, step)
