"""Coulomb friction with the normal force and tangent plane of the last step (lagged), smoothed around rest.

    P = Σ_pairs μ λ_n f₀(‖u‖),   u = T_nᵀ (x − x̂),   f₀(y) = y³/(−3ε²) + y²/ε + ε/3 for y < ε = s ε_v, else y

u is the tangential slip of the step in the rule's own velocity times s, so a moving collider drags cloth along; D = P/s is the
dissipation [W]. λ_n and T_n are taken at x_n against the collider at the start of the step: one lagging pass, as in C-IPC.

Source: Li et al. 2020 (IPC), eqs. 11-14. Derivatives by ipctk, those through the lag included.
Limits: slides at up to ε_v where it ought to stick; the normal force is one step late.
"""

import ipctk
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from typing_extensions import override

from tasks.simulator.contact_barrier import ContactBarrier
from tasks.simulator.potential import Potential, Step, StepTangent, sparse_times

Array = NDArray[np.float64]


class ContactFriction(Potential):
    """Friction μ against the collider and μ_self among cloth, on the normal forces of `barrier`. Keeps the pairs of the step at hand.

    The parameter `friction` is both coefficients at once, `friction_collider` and `friction_self` are one each.
    """

    parameters = ("log_density", "friction", "friction_collider", "friction_self")

    def __init__(self, barrier: ContactBarrier, *, collider: float, cloth: float, velocity: float) -> None:
        """Coefficients against the collider and among cloth; velocity ε_v [m/s] below which friction is smoothed."""
        self.barrier, self.collider, self.cloth, self.velocity = barrier, collider, cloth, velocity
        self._lag: tuple[Step, ipctk.TangentialCollisions] | None = None

    @override
    def energy(self, x: Array, step: Step) -> float:
        pairs = self._pairs(step)
        return self.barrier.scale(step) * self._friction(step)(pairs, self._mesh, self._slip(x, step)) if len(pairs) else 0.0

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return self._gradient(x, step, self._pairs(step))

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> csc_matrix:
        pairs, U = self._pairs(step), self._slip(x, step)
        if not len(pairs):
            return csc_matrix((U.size, U.size))
        kind = ipctk.PSDProjectionMethod.CLAMP if convex else ipctk.PSDProjectionMethod.NONE
        return self.barrier.scale(step) * self._friction(step).hessian(pairs, self._mesh, U, kind)

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        if name == "log_density":
            return self.gradient(x, step)
        unit = {"friction": (1.0, 1.0), "friction_collider": (1.0, 0.0), "friction_self": (0.0, 1.0)}[name]
        return self._gradient(x, step, self._build(step, *unit))

    @override
    def history_gradient(self, x: Array, step: Step, d: StepTangent) -> Array | None:
        pairs = self._pairs(step)
        if not len(pairs):
            return None
        U, X_n = self._slip(x, step), self._lagged(step)
        wrt = ipctk.FrictionPotential.DiffWRT.LAGGED_DISPLACEMENTS
        surface = self.barrier.surface
        rest = self._mesh.rest_positions
        J = self._friction(step).force_jacobian(
            pairs, self._mesh, rest, np.asfortranarray(X_n - rest), U, self.barrier.barrier, wrt, surface.offset
        )
        H = self._friction(step).hessian(pairs, self._mesh, U)
        n, still = x.size, len(d.x_n) - len(d.collider)
        out = -sparse_times(H[:n, :n], d.x_hat) - sparse_times(J[:n, :n], d.x_n)
        out[still:] += sparse_times(H[:n, n:], d.collider - d.collider_hat) - sparse_times(J[:n, n:], d.collider_n)
        return self.barrier.scale(step) * out

    def _gradient(self, x: Array, step: Step, pairs: ipctk.TangentialCollisions) -> Array:
        if not len(pairs):
            return np.zeros_like(x)
        g = self._friction(step).gradient(pairs, self._mesh, self._slip(x, step)).reshape(-1, 3)
        return self.barrier.scale(step) * g[: len(x)]

    def _pairs(self, step: Step) -> ipctk.TangentialCollisions:
        if self._lag is None or self._lag[0].x_n is not step.x_n or self._lag[0].s != step.s:
            self._lag = (step, self._build(step, self.collider, self.cloth))
        return self._lag[1]

    def _build(self, step: Step, collider: float, cloth: float) -> ipctk.TangentialCollisions:
        surface, X_n = self.barrier.surface, self._lagged(step)
        # ipctk takes the mean of the two vertices' coefficients: cloth-cloth gives `cloth`, cloth-collider gives `collider`
        μ = np.full(len(X_n), 2 * collider - cloth)
        μ[: surface.cloth_size] = cloth
        pairs = ipctk.TangentialCollisions()
        pairs.build(surface.mesh, X_n, surface.pairs(X_n), self.barrier.barrier, μ, μ)
        return pairs

    def _friction(self, step: Step) -> ipctk.FrictionPotential:
        return ipctk.FrictionPotential(self.velocity * step.s)

    def _slip(self, x: Array, step: Step) -> Array:
        return np.asfortranarray(np.concatenate([x - step.x_hat, step.collider - step.collider_hat]))

    def _lagged(self, step: Step) -> Array:
        return self.barrier.surface.join(step.x_n, step.collider_n)

    @property
    def _mesh(self) -> ipctk.CollisionMesh:
        return self.barrier.surface.mesh
