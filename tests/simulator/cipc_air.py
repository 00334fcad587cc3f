"""The air that was added to C-IPC for the recording `skirt_drag`: per face ½ ρ_a A (C_n |v_n| P + C_t |v_t| (I − P)) v, P = n nᵀ.

Its speeds |v_n|, |v_t| and its normals are those of the step before, so that its force is linear in the velocity; the effects of the
library take the speeds of the step itself. Good for one step: the lagged velocities are given.
"""

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Subject
from tasks.effects.faces_in_air import AIR_DENSITY, PlatesTerm, across
from tasks.simulator import NO_COLLIDER, Cloth, Fabric
from tasks.simulator.potential import Array


class LaggedAir(PlatesTerm):
    """φ = ¼ ρ_a (C_n |u_n| r_n² + C_t |u_t| |r_t|²), u: velocity of a face one step before."""

    def __init__(self, cloth: Cloth, fabric: Fabric, v: Array, *, across: float, along: float) -> None:
        """v [V, 3] m/s: velocities one step before; across, along: C_n and C_t."""
        subject = Subject(cloth, fabric, NO_COLLIDER, np.full(len(cloth.x_rest), "free"), 25.0)
        super().__init__(subject, "air", 1 / fabric.areal_density)
        self.u, self.coefficients = self.air.mean(v), (across, along)

    @override
    def density(self, r: Array, n: Array) -> Array:
        return 0.5 * np.einsum("fi,fij,fj->f", r, self.curvature(r, n, convex=True), r)

    @override
    def slope(self, r: Array, n: Array) -> Array:
        return np.einsum("fij,fj->fi", self.curvature(r, n, convex=True), r)

    @override
    def curvature(self, r: Array, n: Array, *, convex: bool) -> Array:
        u_n, P = across(self.u, n), np.einsum("fi,fj->fij", n, n)
        u_t = np.linalg.norm(self.u - u_n[:, None] * n, axis=1)
        c_n, c_t = self.coefficients
        return AIR_DENSITY / 2 * ((c_n * np.abs(u_n))[:, None, None] * P + (c_t * u_t)[:, None, None] * (np.eye(3) - P))
