"""Newton's directions through one step: H p = −g, with few factorisations.

The exact Hessian H is tried first; when it has no Cholesky factor, (1 − λ) H + λ H₊ with the convex neighbours H₊ of the terms and the least λ of
a ladder that has one. λ is lowered after every success, so that the last iterations converge quadratically. (Using H₊ itself, buckling cloth
crawled: more than 300 iterations for a step that takes 10.)

Within a step H changes little. So once it had a factor, H p = −g is solved by conjugate gradients on the Hessian at hand with that factor for a preconditioner,
until the error is `FORCING` of what it was. Where that takes more than `MOST` iterations, or meets a direction of negative curvature, H is factorised
anew. A direction found without meeting one goes downhill, as Newton's own does.

Source: Dembo, Eisenstat, Steihaug 1982 (inexact Newton methods); Steihaug 1983 (negative curvature).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from tasks.simulator.linear_system import Factor, LinearSystem, NotPositiveDefinite, symmetric_product
from tasks.simulator.potential import Blocks, Potential, Step

Array = NDArray[np.float64]
Terms = list[Blocks | csc_matrix]

FORCING = 1e-4  # share of the error, in the norm of H⁻¹, that conjugate gradients leave
MOST = 16  # of their iterations, which cost a twentieth of a factorisation each
LADDER = (0.0, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)  # shares λ of the convex neighbours


class Directions:
    """Of one step. Keeps the share λ, and the factor of the exact Hessian while it serves."""

    def __init__(self, potentials: Sequence[Potential], system: LinearSystem) -> None:
        self._potentials, self._system = potentials, system
        self._rung = 0
        self._factor: Factor | None = None

    def newton(self, x: Array, step: Step, g: Array) -> Array:
        """The direction [V, 3] from x [V, 3], where the gradient is g [V, 3]. Raises NotPositiveDefinite if nothing is: values overflowed."""
        still = np.zeros_like(x)
        return self.answer(x, step, g, still, np.zeros_like(step.collider))

    def answer(self, x: Array, step: Step, g: Array, fixed: Array, Δc: Array) -> Array:
        """The same that foresees a motion of the prescribed nodes, `fixed` [V, 3], and of the collider, Δc [C, 3]."""
        λ = LADDER[self._rung]
        neighbours = hessians(self._potentials, x, step, convex=True) if λ else None
        exact = self._exact(x, step, neighbours)
        A = self._system.assemble(exact)
        if self._factor is not None and not λ:
            p = preconditioned(A, self._right_hand(g, exact, fixed, Δc), self._factor)
            if p is not None:
                return self._system.scatter(p) + fixed
        factor, terms = self._factorised(A, x, step, exact, neighbours)
        return self._system.scatter(factor.solve(self._right_hand(g, terms, fixed, Δc))) + fixed

    def _right_hand(self, g: Array, terms: Terms, fixed: Array, Δc: Array) -> Array:
        moved = fixed.any() or Δc.any()
        return -self._system.gather(g + times(terms, fixed, Δc) if moved else g)

    def _exact(self, x: Array, step: Step, neighbours: Terms | None) -> Terms:
        """Exact Hessians, but contact as in `neighbours` if there are any: its eigenvalues are costly and its curvature hardly negative."""
        if neighbours is None:
            return hessians(self._potentials, x, step, convex=False)
        pairs = zip(self._potentials, neighbours, strict=True)
        return [p.hessian(x, step, convex=False) if isinstance(n, Blocks) else n for p, n in pairs]

    def _factorised(self, A: csc_matrix, x: Array, step: Step, exact: Terms, neighbours: Terms | None) -> tuple[Factor, Terms]:
        """Factor of the least convex mixture that has one, and the Hessians it stands for."""
        system, B = self._system, None
        while True:
            λ = LADDER[self._rung]
            if λ and B is None:
                neighbours = neighbours or hessians(self._potentials, x, step, convex=True)
                B = system.assemble(neighbours)
                if B.nnz != A.nnz:  # contact asked for more blocks
                    A = system.assemble(exact)
            try:
                factor = system.factorise(_mixture(A, B, λ))
            except NotPositiveDefinite:
                if λ == 1:
                    raise
                self._rung += 1
            else:
                self._rung = max(self._rung - 1, 0)
                self._factor = None if λ else factor
                return factor, (neighbours or exact) if λ else exact


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


def preconditioned(A: csc_matrix, b: Array, factor: Factor) -> Array | None:
    """A⁻¹ b [n] by conjugate gradients, A given by its lower triangle; None where they meet negative curvature or take too long."""
    p, r = np.zeros_like(b), b.copy()
    z = factor.solve(r)
    q, rz = z, float(r @ z)
    enough = FORCING**2 * rz
    for _ in range(MOST):
        Aq = symmetric_product(A, q)
        curvature = float(q @ Aq)
        if not curvature > 0:
            return None
        α = rz / curvature
        p, r = p + α * q, r - α * Aq
        z = factor.solve(r)
        before, rz = rz, float(r @ z)
        if rz <= enough:
            return p
        q = z + rz / before * q
    return None


def _mixture(A: csc_matrix, B: csc_matrix | None, λ: float) -> csc_matrix:
    """(1 − λ) A + λ B of one pattern, which scipy's own sum would prune."""
    return A if B is None else csc_matrix(((1 - λ) * A.data + λ * B.data, A.indices, A.indptr), shape=A.shape)
