"""One implicit step: Newton's method on the sum of the potentials, along paths free of contact.

First the prescribed nodes and the collider are carried to their targets *inside* Newton's steps: with Δ the rest of their way,
H p = −∇P − H_prescribed Δ is the answer of the cloth to first order, and continuous collision detection says how much of (p, Δ) may be
done. Then plain Newton with backtracking (Armijo) until the residual acceleration √(Σ‖∂P/∂x‖²/m / Σm) is small. The exact Hessian H is
tried first; when it has no Cholesky factor, (1 − λ) H + λ H₊ with the convex neighbours H₊ of the terms and the least λ of a ladder
that has one. λ is lowered after every success, so that the last steps converge quadratically. (Using H₊ itself, buckling cloth crawled:
more than 300 iterations for a step that takes 10.)

Source: Nocedal & Wright, ch. 3; Li et al. 2020 (IPC), §4 for the step bound.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from tasks.simulator.contact_surface import ContactSurface
from tasks.simulator.linear_system import Factor, LinearSystem, NotPositiveDefinite
from tasks.simulator.potential import Blocks, Potential, Step

Array = NDArray[np.float64]
Indices = NDArray[np.int32]
CONVERGED = "converged"
STUCK = 5  # advances in a row of less than 2 % of the way that mean there is no way
DONE = 1 - 1e-9  # share of the prescribed motion that counts as all of it


@dataclass(frozen=True)
class Solution:
    """x [V, 3], how the step ended ("converged" or a reason), the Newton iterations and the residual acceleration [m/s²] it ended with.

    collider [C, 3]: where it stands if it was left short of its target.
    """

    x: Array
    ending: str
    iterations: int
    residual: float
    collider: Array | None = None

    @property
    def converged(self) -> bool:
        """Whether the step may be kept."""
        return self.ending == CONVERGED


@dataclass(frozen=True)
class Problem:
    """What every step solves: terms, system of free nodes, surface of contact, nodal masses [V] kg, tolerances [m/s²], [m/s]."""

    potentials: Sequence[Potential]
    system: LinearSystem
    surface: ContactSurface
    mass: Array
    boundary: Indices
    tolerance: float
    velocity_tolerance: float
    most_iterations: int

    def energy(self, x: Array, step: Step) -> float:
        """P(x) [J]."""
        return sum(p.energy(x, step) for p in self.potentials)

    def gradient(self, x: Array, step: Step) -> Array:
        """∂P/∂x [V, 3] N."""
        return np.sum([p.gradient(x, step) for p in self.potentials], axis=0)

    def hessians(self, x: Array, step: Step, *, convex: bool) -> list[Blocks | csc_matrix]:
        """∂²P/∂x², term by term."""
        return [p.hessian(x, step, convex=convex) for p in self.potentials]

    def residual(self, g: Array) -> float:
        """Root mean square acceleration [m/s²] that the forces g [V, 3] left over would cause on the free nodes."""
        free = self.system.free
        m = self.mass[free]
        return float(np.sqrt(np.sum(g[free] ** 2 / m[:, None]) / max(m.sum(), 1e-300)))

    def speed(self, dx: Array, step: Step) -> float:
        """Root mean square of dx/h on the free nodes [m/s]."""
        free = self.system.free
        return float(np.sqrt(np.mean(np.sum(dx[free] ** 2, 1)))) / step.h

    def factorise(self, x: Array, step: Step, convexity: "Convexity") -> tuple[Factor, list[Blocks | csc_matrix]]:
        """Factor of the least convex mixture that has one, and the Hessians (the exact ones if they alone did)."""
        neighbours = self.hessians(x, step, convex=True) if convexity.share else None
        exact = self._exact(x, step, neighbours)
        A, B = self.system.assemble(exact), None
        while True:
            λ = convexity.share
            if λ and B is None:
                neighbours = neighbours or self.hessians(x, step, convex=True)
                B = self.system.assemble(neighbours)
                if B.nnz != A.nnz:  # contact asked for more blocks
                    A = self.system.assemble(exact)
            try:
                factor = self.system.factorise(_mixture(A, B, λ))
            except NotPositiveDefinite:
                if λ == 1:
                    raise
                convexity.raise_()
            else:
                convexity.lower()
                return factor, (neighbours or exact) if λ else exact

    def _exact(self, x: Array, step: Step, neighbours: list[Blocks | csc_matrix] | None) -> list[Blocks | csc_matrix]:
        """Exact Hessians, but contact as in `neighbours` if there are any: its eigenvalues are costly and its curvature hardly negative."""
        if neighbours is None:
            return self.hessians(x, step, convex=False)
        pairs = zip(self.potentials, neighbours, strict=True)
        return [p.hessian(x, step, convex=False) if isinstance(n, Blocks) else n for p, n in pairs]


def _mixture(A: csc_matrix, B: csc_matrix | None, λ: float) -> csc_matrix:
    """(1 − λ) A + λ B of one pattern, which scipy's own sum would prune."""
    return A if B is None else csc_matrix(((1 - λ) * A.data + λ * B.data, A.indices, A.indptr), shape=A.shape)


class Convexity:
    """Share λ of the convex neighbours in the Hessian (1 − λ) H + λ H₊: raised until Cholesky succeeds, lowered after every success."""

    LADDER = (0.0, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)

    def __init__(self) -> None:
        self._rung = 0

    @property
    def share(self) -> float:
        """λ."""
        return self.LADDER[self._rung]

    def raise_(self) -> None:
        """It was too little."""
        self._rung += 1

    def lower(self) -> None:
        """It sufficed: try less next time."""
        self._rung = max(self._rung - 1, 0)


def solve(problem: Problem, x: Array, step: Step, *, boundary_target: Array) -> Solution:
    """Minimise from x [V, 3], which is free of contact with the collider at step.collider_n; boundary_target [B, 3] m."""
    convexity = Convexity()
    try:
        advance = _advance(problem, x, step, boundary_target, convexity)
        if not advance.converged:
            return advance
        return minimise(problem, advance.x, step, advance.iterations, convexity)
    except NotPositiveDefinite:
        return Solution(x, "the Hessian overflowed: the start is not finite or surfaces touch; see the frame before", 0, np.inf)


def _advance(problem: Problem, x: Array, step: Step, target: Array, convexity: Convexity) -> Solution:
    """Carry boundary and collider to where they belong, the cloth answering."""
    B, surface, end = problem.boundary, problem.surface, step.collider
    here = replace(step, collider=step.collider_n)
    iterations = stuck = 0
    while True:
        Δb, Δc = target - x[B], end - here.collider
        if not (np.any(Δb) or np.any(Δc)):
            return Solution(x, CONVERGED, iterations, np.inf)
        if iterations >= problem.most_iterations or stuck > STUCK:
            left = max(np.abs(Δb).max(initial=0), np.abs(Δc).max(initial=0))
            return Solution(x, _blocked(surface.tightest(surface.join(x, here.collider)), left), iterations, np.inf)
        p = _answer(problem, x, here, Δb, Δc, convexity)
        X, Y = surface.join(x, here.collider), surface.join(x + p, end)
        surface.prepare(X, Y)
        share = surface.free_step(X, Y)
        iterations += 1
        if share >= DONE:
            x = x + p
            x[B] = target
            here = step
        else:
            x = x + share * p
            stuck = stuck + 1 if share < 0.02 else 0
            here = replace(step, collider=here.collider + share * Δc)
            if share < 0.5:
                x, used = _relax(problem, x, here, convexity)
                iterations += used


def _blocked(pair: str, left: float) -> str:
    return f"the prescribed motion is blocked with {1e3 * left:.2g} mm to go: {pair}; keep the collider apart there, or use more substeps"


def _answer(problem: Problem, x: Array, step: Step, Δb: Array, Δc: Array, convexity: Convexity) -> Array:
    """Newton step [V, 3] that foresees the motion Δ of what is prescribed."""
    fixed = np.zeros_like(x)
    fixed[problem.boundary] = Δb
    factor, terms = problem.factorise(x, step, convexity)
    g = problem.gradient(x, step) + times(terms, fixed, Δc)
    return problem.system.scatter(factor.solve(-problem.system.gather(g))) + fixed


def times(terms: Sequence[Blocks | csc_matrix], dx: Array, dc: Array) -> Array:
    """Product [V, 3] of the Hessians with a motion of cloth dx [V, 3] and collider dc [C, 3]."""
    total = np.zeros_like(dx)
    for term in terms:
        if isinstance(term, Blocks):
            total += term.times(dx[None])[0] if dx.any() else 0.0
        elif term.nnz:
            total += (term @ np.concatenate([dx, dc]).ravel())[: dx.size].reshape(-1, 3)
    return total


def _relax(problem: Problem, x: Array, step: Step, convexity: Convexity) -> tuple[Array, int]:
    """A few plain Newton steps with everything prescribed held, so that gaps open again."""
    for iteration in range(3):
        x, moved, _ = _newton_step(problem, x, step, problem.gradient(x, step), convexity)
        if moved > 0.5:
            return x, iteration + 1
    return x, 3


def minimise(problem: Problem, x: Array, step: Step, iterations: int = 0, convexity: Convexity | None = None) -> Solution:
    """From x [V, 3] where boundary and collider are at their targets already; `iterations` have been spent on that."""
    convexity, energy = convexity or Convexity(), None
    while True:
        g = problem.gradient(x, step)
        residual = problem.residual(g)
        if residual <= problem.tolerance:
            return Solution(x, CONVERGED, iterations, residual)
        if iterations >= problem.most_iterations:
            return Solution(x, _unfinished(problem, g, residual, iterations), iterations, residual)
        x_next, share, energy = _newton_step(problem, x, step, g, convexity, energy)
        iterations += 1
        if share == 0:
            return Solution(x, _unfinished(problem, g, residual, iterations), iterations, residual)
        if problem.speed(x_next - x, step) < problem.velocity_tolerance * share:
            return Solution(x_next, CONVERGED, iterations, residual)
        x = x_next


def _newton_step(
    problem: Problem, x: Array, step: Step, g: Array, convexity: Convexity, energy: float | None = None
) -> tuple[Array, float, float]:
    """x after one step, the share of it that was taken, and the energy there; `energy`: that at x, if it is known."""
    factor, _ = problem.factorise(x, step, convexity)
    p = problem.system.scatter(factor.solve(-problem.system.gather(g)))
    surface = problem.surface
    X, Y = surface.join(x, step.collider), surface.join(x + p, step.collider)
    surface.prepare(X, Y)
    share = surface.free_step(X, Y)
    slope = float(np.sum(g * p))
    energy = problem.energy(x, step) if energy is None else energy
    while share > 1e-8:
        y = x + share * p
        there = problem.energy(y, step)
        # once the promised change drowns in rounding, the energy can no longer judge the step
        if there - energy <= 1e-4 * share * slope or -slope < 1e-11 * abs(energy):
            return y, share, there
        share /= 2
    return x, 0.0, energy


def _unfinished(problem: Problem, g: Array, residual: float, iterations: int) -> str:
    free = problem.system.free
    worst = free[int(np.argmax(np.sum(g[free] ** 2, 1) / problem.mass[free] ** 2))]
    return (
        f"Newton stopped after {iterations} iterations at a residual of {residual:.3g} m/s² (tolerance {problem.tolerance:.3g}), "
        f"worst at vertex {worst}; use more substeps or loosen acceleration_tolerance"
    )
