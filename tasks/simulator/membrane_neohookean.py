"""Compressible neo-Hookean membrane with plane-stress Lamé parameters: the material of C-IPC.

    ψ = t [ μ/2 (tr C − 2 − 2 ln J) + λ/2 (ln J)² ],   ln J = ½ ln det C,   μ = E/(2(1 + ν)),  λ = E ν/(1 − ν²)
    S = t [ μ (I − C⁻¹) + λ ln J C⁻¹ ],   𝔻 = t [ λ C⁻¹⊗C⁻¹ + 2(μ − λ ln J) 𝕀_C⁻¹ ]

Source: Li, Kaufman, Jiang 2021 (Codim-IPC) and its released code. Limits: isotropic; infinite energy as a triangle loses its area.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numba import njit
from numpy.typing import NDArray
from typing_extensions import override

from tasks.simulator import strain
from tasks.simulator.cloth import Cloth
from tasks.simulator.fabric import Fabric
from tasks.simulator.potential import Blocks, Potential, Step

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MembraneNeoHookean(Potential):
    """Faces [F, 3], shape gradients N [F, 3, 2], rest areas [F] m², μt and λt [N/m]."""

    faces: NDArray[np.int32]
    N: Array
    area: Array
    mu: float
    lam: float
    parameters = ("log_membrane", "log_rest_scale")

    @classmethod
    def of(cls, cloth: Cloth, fabric: Fabric) -> Self:
        """The membrane of C-IPC. Raises ValueError for an orthotropic fabric."""
        if fabric.orthotropy:
            raise ValueError("the neo-Hookean membrane is isotropic: set orthotropy to 0 or membrane to 'stvk'")
        N, area = strain.rest_frames(cloth.x_rest, cloth.faces, cloth.uv)
        c, Et, ν = fabric.rest_scale, fabric.stretch_stiffness, fabric.poisson
        return cls(cloth.faces, N / c, area * c**2, Et / (2 * (1 + ν)), Et * ν / (1 - ν**2))

    @override
    def energy(self, x: Array, step: Step) -> float:
        C = strain.metric(x, self.faces, self.N)
        determinant = C[:, 0] * C[:, 1] - C[:, 2] ** 2
        if not (determinant > 0).all():
            return np.inf
        lnJ = 0.5 * np.log(determinant)
        ψ = self.mu / 2 * (C[:, 0] + C[:, 1] - 2 - 2 * lnJ) + self.lam / 2 * lnJ**2
        return float(self.area @ ψ)

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        S, _ = _response(strain.metric(x, self.faces, self.N), self.mu, self.lam)
        return strain.gradient(x, self.faces, self.N, self.area, S)

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        S, D = _response(strain.metric(x, self.faces, self.N), self.mu, self.lam)
        return Blocks(self.faces, strain.hessian(x, self.faces, self.N, self.area, S, D, convex))

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        C = strain.metric(x, self.faces, self.N)
        S, D = _response(C, self.mu, self.lam)
        if name == "log_rest_scale":
            S = -np.einsum("fij,fj->fi", D, C * (1.0, 1.0, 2.0))  # ∂E/∂log c = −C, and Ā N N does not change
        elif name != "log_membrane":
            raise KeyError(name)
        return strain.gradient(x, self.faces, self.N, self.area, S)


@njit(cache=True, nogil=True, error_model="numpy")
def _response(C, mu, lam):
    """S [F, 3] and 𝔻 [F, 3, 3]."""
    S, D = np.empty_like(C), np.empty((len(C), 3, 3))
    for i in range(len(C)):
        det = C[i, 0] * C[i, 1] - C[i, 2] ** 2
        lnJ = 0.5 * np.log(det)
        a, b, c = C[i, 1] / det, C[i, 0] / det, -C[i, 2] / det  # C⁻¹
        m, g = 2 * (mu - lam * lnJ), lam * lnJ - mu
        S[i, 0], S[i, 1], S[i, 2] = mu + g * a, mu + g * b, g * c
        D[i, 0, 0], D[i, 1, 1] = (lam + m) * a * a, (lam + m) * b * b
        D[i, 0, 1] = D[i, 1, 0] = lam * a * b + m * c * c
        D[i, 0, 2] = D[i, 2, 0] = (lam + m) * a * c
        D[i, 1, 2] = D[i, 2, 1] = (lam + m) * b * c
        D[i, 2, 2] = lam * c * c + m * (a * b + c * c) / 2
    return S, D
