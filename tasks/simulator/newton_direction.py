"""Newton's directions through one step: H p = −g.

The exact Hessian H is tried first; where it is not positive definite, (1 − λ) H + λ H₊ with the convex neighbours H₊ of the terms and the
least λ of a ladder that is. λ is lowered after every success, so that the last iterations converge quadratically. (With H₊ itself, buckling
cloth crawls: more than 300 iterations for a step that takes 10.) Where steps end at a velocity, as C-IPC's do, often while still leaving a
saddle, there is no such end to reach, and H₊ serves alone.

In large systems a factor serves for further directions, at a fifth of the price or less, corrected by what the gradient has done since
(L-BFGS with H₀⁻¹ by the factor). Stretch that a rotation leaves in stiff cloth is the reason: across it the energy grows with the fourth
power, where Newton's own steps leave 0.3 of the residual each, and secants leave 0.45. In small ones everything else that a step asks for
costs as much as a factor, and each direction has its own. (Conjugate gradients on an older factor took as many solutions as a factorisation
costs: 13 at 1,600 vertices, 10 at 25,000.)

Source: Nocedal 1980 (L-BFGS, two loops); Liu, Bouaziz & Kavan 2017 (a kept factor as its start).
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from tasks.simulator.linear_system import Factor, LinearSystem, NotPositiveDefinite
from tasks.simulator.potential import Blocks, Potential, Step

Array = NDArray[np.float64]
Terms = list[Blocks | csc_matrix]

LADDER = (0.0, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)  # shares λ of the convex neighbours
LARGE = 3000  # unknowns from which a factor is dear enough to serve again
CURVED = 1e-12  # sᵀy over |s||y| from which a curvature is told from rounding


class Directions:
    """Of one step. Keeps the share λ, the last factor, and what steps since then did to the gradient. convex: the neighbours alone.

    serve_again: whether factors serve for further directions.
    """

    def __init__(self, potentials: Sequence[Potential], system: LinearSystem, *, convex: bool = False) -> None:
        self._potentials, self._system = potentials, system
        self.serve_again = system.size >= LARGE and not convex
        self._lowest = self._rung = len(LADDER) - 1 if convex else 0
        self._factor: Factor | None = None
        self._since: list[tuple[Array, Array, float]] = []  # s, y, sᵀy

    def newton(self, x: Array, step: Step, g: Array) -> Array:
        """The direction [V, 3] from x [V, 3], where the gradient is g [V, 3]. Raises NotPositiveDefinite if nothing is: values overflowed."""
        still = np.zeros_like(x)
        return self.answer(x, step, g, still, np.zeros_like(step.collider))

    def again(self, g: Array) -> Array | None:
        """The direction [V, 3] where the gradient is g [V, 3], by the last factor; None where there is none."""
        if self._factor is None or not self.serve_again:
            return None
        q, shares = -self._system.gather(g), []
        for s, y, sy in reversed(self._since):
            shares.append(float(s @ q) / sy)
            q = q - shares[-1] * y
        p = self._factor.solve(q)
        for (s, y, sy), share in zip(self._since, reversed(shares), strict=True):
            p = p + (share - float(y @ p) / sy) * s
        return self._system.scatter(p)

    def learn(self, dx: Array, dg: Array) -> None:
        """A step dx [V, 3] m changed the gradient by dg [V, 3] N; where the curvature along it is not positive, nothing is learnt."""
        if not self.serve_again:
            return
        s, y = self._system.gather(dx), self._system.gather(dg)
        sy = float(s @ y)
        if sy > CURVED * np.linalg.norm(s) * np.linalg.norm(y):
            self._since.append((s, y, sy))

    def answer(self, x: Array, step: Step, g: Array, fixed: Array, Δc: Array) -> Array:
        """Newton's, that foresees a motion of the prescribed nodes, `fixed` [V, 3], and of the collider, Δc [C, 3]."""
        here, moves = _Hessians(self._potentials, self._system, x, step), fixed.any() or Δc.any()
        while True:
            λ = LADDER[self._rung]
            A, terms = here.mixed(λ)
            carried = times(terms, fixed, Δc) if moves else 0.0
            try:
                self._factor, self._since = self._system.factorise(A), []
                p = self._factor.solve(-self._system.gather(g + carried))
            except NotPositiveDefinite:
                if λ == 1:
                    raise
                self._rung += 1
            else:
                self._rung = max(self._rung - 1, self._lowest)
                return self._system.scatter(p) + fixed


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
