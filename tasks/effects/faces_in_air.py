"""Faces of cloth as small plates in still air: their motion, and terms that depend on it and on where they point.

    P = τ ρ̄ Σ_faces A φ(r, n),   r = mean over the corners of (x − x₀)/τ

r is the velocity (τ = s, x₀ = x̂: φ is a dissipation) or the acceleration (τ = s², x₀ = x̃: φ is a kinetic energy). n, A: normal and area
at x_n (lagged), so that the Hessian is symmetric; derivatives go through the lag. Each corner takes a third of its face's force.
"""

from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray
from typing_extensions import override

from tasks.effects.effect import Subject
from tasks.effects.stencil_levers import lever, rates
from tasks.simulator.potential import NO_STIFFNESS, Array, Blocks, Potential, Step, StepTangent

AIR_DENSITY = 1.2  # ρ_a [kg/m³], 20 °C at sea level


class FacesInAir:
    """Faces [F, 3] among V vertices."""

    def __init__(self, faces: NDArray[np.int32], vertex_count: int) -> None:
        self.faces, self.vertex_count = faces, vertex_count
        self._at: tuple[Array, Array, Array] | None = None

    def normals(self, x: Array) -> tuple[Array, Array]:
        """Unit normals [F, 3] and areas [F] m² at x [V, 3]."""
        if self._at is None or self._at[0] is not x:
            a, b, c = (x[self.faces[:, k]] for k in range(3))
            N = np.cross(b - a, c - a) / 2
            A = np.linalg.norm(N, axis=1)
            self._at = (x, N / A[:, None], A)
        return self._at[1:]

    def turned(self, x: Array, dx: Array, force: Array, by_normal: Array) -> Array:
        """Derivatives [P, F, 3] along dx [P, V, 3] of forces [F, 3] that grow with the area and have the slopes by_normal [F, 3, 3] in n.

        With N = A n:  dn = (I − n nᵀ) dN/A,  dA/A = n·dN/A,  dN = ½ Σ_corners e × dx, e being the edge across from the corner.
        """
        n, A = self.normals(x)
        plane = np.eye(3) - np.einsum("fi,fj->fij", n, n)
        slope = (by_normal @ plane + np.einsum("fi,fj->fij", force, n)) / (2 * A[:, None, None])
        a, b, c = (x[self.faces[:, k]] for k in range(3))
        edges = np.stack([c - b, a - c, b - a], 1)
        return self._rates(np.cross(slope[:, :, None], edges[:, None]), dx)  # a·(e × d) = (a × e)·d

    def carried(self, field: Array, slope: Array) -> Array:
        """slope [F, 3, 3] times the mean over the corners of a field [P, V, 3] -> [P, F, 3]."""
        return self._rates(np.repeat(slope[:, :, None] / 3, 3, axis=2), field)

    def mean(self, field: Array) -> Array:
        """Mean over the corners of a field [..., V, 3] -> [..., F, 3]."""
        return _mean(self.faces, _columns(field)).reshape(*field.shape[:-2], len(self.faces), 3)

    def to_corners(self, force: Array) -> Array:
        """A third of the force [..., F, 3] of each face at each of its corners -> [..., V, 3]."""
        return _to_corners(self.faces, _columns(force), self.vertex_count).reshape(*force.shape[:-2], self.vertex_count, 3)

    def _rates(self, slopes: Array, dx: Array) -> Array:
        """Σ_corners slopes · dx [P, F, 3] for slopes [F, 3, 3 corners, 3]."""
        return rates(lever(self._rows, slopes.reshape(-1, 3, 3), self.vertex_count), dx).reshape(len(dx), -1, 3)

    @cached_property
    def _rows(self) -> NDArray[np.int32]:
        return np.repeat(self.faces, 3, axis=0)


class PlatesTerm(Potential):
    """P = strength τ ρ̄ Σ A φ(r, n) for one φ, given by the four methods below; no cost at strength zero."""

    def __init__(self, subject: Subject, name: str, strength: float) -> None:
        """The parameter `name` is the factor before φ. The gauge is kept: the force grows with the areal density ρ̄."""
        cloth = subject.cloth
        self.air, self.strength, self.areal_density = FacesInAir(cloth.faces, len(cloth.x_rest)), strength, subject.fabric.areal_density
        self.parameters = (name, "log_density")

    def density(self, r: Array, n: Array) -> Array:
        """φ [F] for r, n [F, 3]."""
        raise NotImplementedError

    def slope(self, r: Array, n: Array) -> Array:
        """∂φ/∂r [F, 3]."""
        raise NotImplementedError

    def curvature(self, r: Array, n: Array, *, convex: bool) -> Array:
        """∂²φ/∂r² [F, 3, 3]."""
        raise NotImplementedError

    def turn(self, r: Array, n: Array) -> Array:
        """∂²φ/∂r∂n [F, 3, 3]."""
        raise NotImplementedError

    def scale(self, step: Step) -> float:
        """τ: here s, r being the velocity."""
        return step.s

    def origin(self, step: Step) -> Array:
        """x₀ [V, 3]: here x̂."""
        return step.x_hat

    def origin_tangent(self, step: Step, d: StepTangent) -> Array:
        """dx₀ [P, V, 3]."""
        return d.x_hat

    @property
    def idle(self) -> bool:
        """Whether the term vanishes for any motion."""
        return self.strength == 0

    @override
    def energy(self, x: Array, step: Step) -> float:
        if self.idle:
            return 0.0
        r, n, mass = self._motion(x, step)
        return self.strength * self.scale(step) * float(mass @ self.density(r, n))

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return np.zeros_like(x) if self.idle else self.strength * self.unit_gradient(x, step)

    def unit_gradient(self, x: Array, step: Step) -> Array:
        """∂P/∂x [V, 3] at strength one."""
        r, n, mass = self._motion(x, step)
        return self.air.to_corners(mass[:, None] * self.slope(r, n))

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        if self.idle:
            return NO_STIFFNESS
        r, n, mass = self._motion(x, step)
        C = (self.strength / self.scale(step) / 9 * mass)[:, None, None] * self.curvature(r, n, convex=convex)
        return Blocks(self.air.faces, np.tile(C, (1, 3, 3)))

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        if name not in self.parameters:
            raise KeyError(name)
        return self.gradient(x, step) if name == "log_density" else self.unit_gradient(x, step)

    @override
    def history_gradient(self, x: Array, step: Step, d: StepTangent) -> Array | None:
        if self.idle:
            return None
        r, n, mass = self._motion(x, step)
        force, by_normal = mass[:, None] * self.slope(r, n), mass[:, None, None] * self.turn(r, n)
        by_rate = (-mass / self.scale(step))[:, None, None] * self.curvature(r, n, convex=False)
        df = self.air.turned(step.x_n, d.x_n, force, by_normal) + self.air.carried(self.origin_tangent(step, d), by_rate)
        return self.strength * self.air.to_corners(df)

    def _motion(self, x: Array, step: Step) -> tuple[Array, Array, Array]:
        """r, n [F, 3] and the mass ρ̄A [F] kg of the faces."""
        n, A = self.air.normals(step.x_n)
        return self.air.mean(x - self.origin(step)) / self.scale(step), n, self.areal_density * A


class SquareAcross(PlatesTerm):
    """φ = ½ (r·n)²."""

    @override
    def density(self, r: Array, n: Array) -> Array:
        return across(r, n) ** 2 / 2

    @override
    def slope(self, r: Array, n: Array) -> Array:
        return across(r, n)[:, None] * n

    @override
    def curvature(self, r: Array, n: Array, *, convex: bool) -> Array:
        return outer(np.ones(len(n)), n)

    @override
    def turn(self, r: Array, n: Array) -> Array:
        u = across(r, n)
        return turn_across(r, n, u, np.ones_like(u))


def across(r: Array, n: Array) -> Array:
    """The part of r along the normals n: r·n [F]."""
    return np.einsum("fi,fi->f", r, n)


def turn_across(r: Array, n: Array, slope: Array, curvature: Array) -> Array:
    """`turn` of φ(r, n) = ψ(r·n), given ψ′ and ψ″ [F]:  ψ″ n rᵀ + ψ′ I  [F, 3, 3]."""
    return np.einsum("f,fi,fj->fij", curvature, n, r) + slope[:, None, None] * np.eye(3)


def outer(c: Array, n: Array) -> Array:
    """c n nᵀ [F, 3, 3]."""
    return np.einsum("f,fi,fj->fij", c, n, n)


def _columns(field: Array) -> Array:
    """A field [..., A, 3] as [P, A, 3]."""
    return np.ascontiguousarray(field).reshape(-1, *field.shape[-2:])


@njit(cache=True, nogil=True)
def _mean(faces, field):
    out = np.empty((len(field), len(faces), 3))
    for p in range(len(field)):
        for f in range(len(faces)):
            for i in range(3):
                out[p, f, i] = (field[p, faces[f, 0], i] + field[p, faces[f, 1], i] + field[p, faces[f, 2], i]) / 3
    return out


@njit(cache=True, nogil=True)
def _to_corners(faces, force, vertex_count):
    out = np.zeros((len(force), vertex_count, 3))
    for p in range(len(force)):
        for f in range(len(faces)):
            for k in range(3):
                for i in range(3):
                    out[p, faces[f, k], i] += force[p, f, i] / 3
    return out
