"""Inertia as a term of the incremental potential:  P = ½ ‖x − x̃‖²_M / s².

M is lumped (a third of the areal mass of each face at each corner, as in C-IPC) or consistent (linear shape functions: ρ̄Ā/12 (1 + δ_pq)).
Source: Li et al. 2020 (IPC), eq. 4; Zienkiewicz & Taylor, vol. 1 (consistent mass).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from tasks.simulator.cloth import Cloth
from tasks.simulator.potential import Blocks, Potential, Step, StepTangent

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Inertia(Potential):
    """Mass as 3m-free scalar blocks: stencils [K, m], values [K, m, m] kg."""

    stencils: NDArray[np.int32]
    values: Array
    parameters = ("log_density",)

    @classmethod
    def of(cls, cloth: Cloth, areal_density: float, *, mass: Literal["lumped", "consistent"] = "lumped") -> Self:
        """Inertia of cloth with areal_density ρ̄ [kg/m²]."""
        if mass == "lumped":
            vertices = np.arange(len(cloth.x_rest), dtype=np.int32)
            return cls(vertices[:, None], (areal_density * cloth.vertex_areas)[:, None, None])
        return cls(cloth.faces, areal_density / 12 * cloth.rest_areas[:, None, None] * (np.ones((3, 3)) + np.eye(3)))

    def times(self, dx: Array) -> Array:
        """M dx for dx [V, 3] or [K, V, 3]."""
        if self.stencils.shape[1] == 1:  # lumped: every vertex once
            return self._diagonal[:, None] * dx
        return self._blocks.times(dx.reshape(-1, *dx.shape[-2:])).reshape(dx.shape)

    @cached_property
    def _diagonal(self) -> Array:
        """Lumped masses [V] kg in the order of the vertices."""
        diagonal = np.zeros(len(self.stencils))
        diagonal[self.stencils[:, 0]] = self.values[:, 0, 0]
        return diagonal

    @cached_property
    def _blocks(self) -> Blocks:
        """M in blocks of three axes."""
        K, m = self.stencils.shape
        return Blocks(self.stencils, np.einsum("kpq,ij->kpiqj", self.values, np.eye(3)).reshape(K, 3 * m, 3 * m))

    @override
    def energy(self, x: Array, step: Step) -> float:
        d = x - step.x_tilde
        return 0.5 * float(np.sum(d * self.times(d))) / step.s**2

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return self.times(x - step.x_tilde) / step.s**2

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        return Blocks(self.stencils, self._blocks.values / step.s**2)

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        if name != "log_density":
            raise KeyError(name)
        return self.gradient(x, step)

    @override
    def history_gradient(self, x: Array, step: Step, d: StepTangent) -> Array:
        return -self.times(d.x_hat + step.s * d.v_hat) / step.s**2
