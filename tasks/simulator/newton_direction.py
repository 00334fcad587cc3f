"""Newton's directions through one step: H p = −g, with few factorisations.

The exact Hessian H is tried first; where it is not positive definite, (1 − λ) H + λ H₊ with the convex neighbours H₊ of the terms and the
least λ of a ladder that is. λ is lowered after every success, so that the last iterations converge quadratically. (With H₊ itself, buckling
cloth crawls: more than 300 iterations for a step that takes 10.) Where steps end at a velocity, as C-IPC's do, often while still leaving a
saddle, there is no such end to reach, and H₊ serves alone.

Within a step H changes little. So whatever was factorised last is the preconditioner of conjugate gradients on the matrix at hand, until
the error is `FORCING` of what it was. Where they meet a direction of negative curvature that matrix is not definite; where they take more
than `MOST` iterations, or promise to, it is factorised. A direction found without meeting one goes downhill, as Newton's own does.

Source: Dembo, Eisenstat, Steihaug 1982 (inexact Newton methods); Steihaug 1983 (negative curvature).
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from tasks.simulator.linear_system import Factor, LinearSystem, NotPositiveDefinite, symmetric_product
from tasks.simulator.potential import Blocks, Potential, Step

Array = NDArray[np.float64]
Terms = list[Blocks | csc_matrix]

# shares of the error, in the norm of H⁻¹, that conjugate gradients leave
FORCING = 1e-4  # of H
MIXED = 1e-2  # of a neighbour that is not Newton's own anyway
CARRIED = 1e-6  # where something prescribed moves: a ten-thousandth of 2 cm, across a gap of a micrometre, closes it
MOST = 24  # of their iterations, which cost a tenth to a twentieth of a factorisation each
EARLY = 8  # of them, after which their pace is known
LADDER = (0.0, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)  # shares λ of the convex neighbours


class Directions:
    """Of one step. Keeps the share λ, and the last factor. convex: the neighbours alone."""

    def __init__(self, potentials: Sequence[Potential], system: LinearSystem, *, convex: bool = False) -> None:
        self._potentials, self._system = potentials, system
        self._lowest = self._rung = len(LADDER) - 1 if convex else 0
        self._factor: Factor | None = None

    def newton(self, x: Array, step: Step, g: Array) -> Array:
        """The direction [V, 3] from x [V, 3], where the gradient is g [V, 3]. Raises NotPositiveDefinite if nothing is: values overflowed."""
        still = np.zeros_like(x)
        return self.answer(x, step, g, still, np.zeros_like(step.collider))

    def answer(self, x: Array, step: Step, g: Array, fixed: Array, Δc: Array) -> Array:
        """The same that foresees a motion of the prescribed nodes, `fixed` [V, 3], and of the collider, Δc [C, 3]."""
        here, moves = _Hessians(self._potentials, self._system, x, step), fixed.any() or Δc.any()
        while True:
            λ = LADDER[self._rung]
            A, terms = here.mixed(λ)
            carried = times(terms, fixed, Δc) if moves else 0.0
            try:
                p = self._solved(A, -self._system.gather(g + carried), CARRIED if moves else MIXED if λ else FORCING)
            except NotPositiveDefinite:
                if λ == 1:
                    raise
                self._rung += 1
            else:
                self._rung = max(self._rung - 1, self._lowest)
                return self._system.scatter(p) + fixed

    def _solved(self, A: csc_matrix, b: Array, forcing: float) -> Array:
        """A⁻¹ b [n]. Raises NotPositiveDefinite."""
        p = None if self._factor is None else preconditioned(A, b, self._factor, forcing)
        if p is None:
            self._factor = self._system.factorise(A)
            p = self._factor.solve(b)
        return p


class _Hessians:
    """Of all terms at one place: exact, convex, and mixed; made when they are first asked for."""

    def __init__(self, potentials: Sequence[Potential], system: LinearSystem, x: Array, step: Step) -> None:
        self._potentials, self._system, self._at = potentials, system, (x, step)

    @cached_property
    def convex(self) -> Terms:
        """H₊, term by term."""
        return hessians(self._potentials, *self._at, convex=True)

    @cached_property
    def exact(self) -> Terms:
        """H, but contact as in the neighbours if these were made: its eigenvalues are costly and its curvature hardly negative."""
        if "convex" not in self.__dict__:
            return hessians(self._potentials, *self._at, convex=False)
        pairs = zip(self._potentials, self.convex, strict=True)
        return [p.hessian(*self._at, convex=False) if isinstance(n, Blocks) else n for p, n in pairs]

    def mixed(self, λ: float) -> tuple[csc_matrix, Terms]:
        """(1 − λ) H + λ H₊ on the free nodes, and the terms that say what a motion of the others does."""
        if λ in (0, 1):
            terms = self.convex if λ else self.exact
            return self._system.assemble(terms), terms
        neighbours, A = self.convex, self._system.assemble(self.exact)
        B = self._system.assemble(neighbours)
        if B.nnz != A.nnz:  # contact asked for more blocks
            A = self._system.assemble(self.exact)
        # of one pattern, which scipy's own sum would prune
        return csc_matrix(((1 - λ) * A.data + λ * B.data, A.indices, A.indptr), shape=A.shape), neighbours


def hessians(potentials: Sequence[Potential], x: Array, step: Step, *, convex: bool) -> Terms:
    """∂²P/∂x², term by term."""
    return [p.hessian(x, step, convex=convex) for p in potentials]


def times(terms: Sequence[Blocks | csc_matrix], dx: Array, dc: Array) -> Array:
    """Product [V, 3] of the Hessians with a motion of cloth dx [V, 3] and collider dc [C, 3]."""
    total = np.zeros_like(dx)
    for term in terms:
        if isinstance(term, Blocks):
            total += term.times(dx[None])[0] if dx.any() else 0.0
        elif term.nnz:
            total += (term @ np.concatenate([dx, dc]).ravel())[: dx.size].reshape(-1, 3)
    return total


def preconditioned(A: csc_matrix, b: Array, factor: Factor, forcing: float) -> Array | None:
    """A⁻¹ b [n] by conjugate gradients, A given by its lower triangle; None where they take too long. Raises NotPositiveDefinite where they
    meet negative curvature.
    """
    p, r = np.zeros_like(b), b.copy()
    z = factor.solve(r)
    q, rz = z, float(r @ z)
    first = rz
    if first == 0:
        return p
    for iteration in range(1, MOST + 1):
        Aq = symmetric_product(A, q)
        curvature = float(q @ Aq)
        if not curvature > 0:
            raise NotPositiveDefinite
        α = rz / curvature
        p, r = p + α * q, r - α * Aq
        z = factor.solve(r)
        before, rz = rz, float(r @ z)
        if rz <= forcing**2 * first:
            return p
        if iteration >= EARLY and (rz / first) ** (MOST / iteration) > forcing**2:
            return None
        q = z + rz / before * q
    return None
