"""St Venant-Kirchhoff membrane under plane stress, isotropic or orthotropic in the pattern directions.

    ψ = ½ Eᵀ 𝔻 E  [J/m²],   𝔻 = t/(1 − ν²) [E_u, ν E, 0; ν E, E_v, 0; 0, 0, ½(1 − ν) E],   E_u = E e^a,  E_v = E e^−a

in Voigt order, the last strain being 2E₁₂. For a = 0 this is t [μ E:E + ½ λ tr(E)²] with μ = E/(2(1 + ν)), λ = E ν/(1 − ν²) (plane stress).

Source: PhysAvatar eq. 7; Bonet & Wood §6.6. Limits: linear in Green strain; softens, then inverts, under compression to less than
1/√3 of the length.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from tasks.simulator import strain
from tasks.simulator.cloth import Cloth
from tasks.simulator.fabric import Fabric
from tasks.simulator.potential import Blocks, Potential, Step

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MembraneStVK(Potential):
    """Faces [F, 3], shape gradients N [F, 3, 2], rest areas [F] m², stiffness D [F, 3, 3] N/m and its derivative in the orthotropy a."""

    faces: NDArray[np.int32]
    N: Array
    area: Array
    D: Array
    D_orthotropy: Array
    parameters = ("log_membrane", "log_rest_scale", "orthotropy")

    @classmethod
    def of(cls, cloth: Cloth, fabric: Fabric) -> Self:
        """The base membrane of a cloth."""
        N, area = strain.rest_frames(cloth.x_rest, cloth.faces, cloth.uv)
        c, F = fabric.rest_scale, len(cloth.faces)
        Et, a = fabric.stretch_stiffness, fabric.orthotropy
        D, dD = plane_stress(Et, fabric.poisson, a)
        return cls(cloth.faces, N / c, area * c**2, np.tile(D, (F, 1, 1)), np.tile(dD, (F, 1, 1)))

    @override
    def energy(self, x: Array, step: Step) -> float:
        E = self._strain(x)
        return 0.5 * float(self.area @ np.sum(E * _apply(self.D, E), 1))

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return strain.gradient(x, self.faces, self.N, self.area, _apply(self.D, self._strain(x)))

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        S = _apply(self.D, self._strain(x))
        return Blocks(self.faces, strain.hessian(x, self.faces, self.N, self.area, S, self.D, convex))

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        E = self._strain(x)
        S = {
            "log_membrane": lambda: _apply(self.D, E),
            "log_rest_scale": lambda: -_apply(self.D, 2 * E + (1.0, 1.0, 0.0)),  # ∂E/∂log c = −C at fixed x, and Ā N N does not change
            "orthotropy": lambda: _apply(self.D_orthotropy, E),
        }[name]()
        return strain.gradient(x, self.faces, self.N, self.area, S)

    def _strain(self, x: Array) -> Array:
        """(E₁₁, E₂₂, 2E₁₂) [F, 3]."""
        return strain.metric(x, self.faces, self.N) * (0.5, 0.5, 1.0) - (0.5, 0.5, 0.0)


def plane_stress(stretch: float, poisson: float, orthotropy: float) -> tuple[Array, Array]:
    """(𝔻, ∂𝔻/∂a) [3, 3] N/m of a sheet with E·t = stretch [N/m]."""
    Et, ν, a = stretch / (1 - poisson**2), poisson, orthotropy
    D = Et * np.array([[np.exp(a), ν, 0], [ν, np.exp(-a), 0], [0, 0, (1 - ν) / 2]])
    return D, Et * np.diag([np.exp(a), -np.exp(-a), 0])


def _apply(D: Array, E: Array) -> Array:
    return np.einsum("fij,fj->fi", D, E)
