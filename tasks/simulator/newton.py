"""One implicit step: Newton's method on the sum of the potentials, along paths free of contact.

First the prescribed nodes and the collider are carried to their targets *inside* Newton's steps: with Δ the rest of their way,
H p = −∇P − H_prescribed Δ is the answer of the cloth to first order, and continuous collision detection says how much of (p, Δ) may be
done. Then plain Newton with backtracking (Armijo) until the residual acceleration √(Σ‖∂P/∂x‖²/m / Σm) is small. Where a step left little
of that, the next goes by the same factor, and a new one is made only where such a step does not suffice, or cannot be taken whole. How H p
is solved: `newton_direction.py`.

Source: Nocedal & Wright, ch. 3; Li et al. 2020 (IPC), §4 for the step bound.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from tasks.simulator.contact_surface import ContactSurface
from tasks.simulator.linear_system import LinearSystem, NotPositiveDefinite
from tasks.simulator.newton_direction import Directions, hessians
from tasks.simulator.potential import Blocks, Potential, Step

Array = NDArray[np.float64]
Indices = NDArray[np.int32]
CONVERGED = "converged"
STUCK = 5  # advances in a row of less than 2 % of the way that mean there is no way
SERVES = 0.6  # share of the residual that a step may leave for the last factor to serve once more
FURTHER = 1e-2  # share of the tolerance at which a step ends where factors serve again: there the last mile is cheap, and rarely overshot
DONE = 1 - 1e-9  # share of the prescribed motion that counts as all of it


@dataclass(frozen=True)
class Solution:
    """x [V, 3], how the step ended ("converged" or a reason), the Newton iterations (further steps on a factor that served before
    are not counted) and the residual acceleration [m/s²] it ended with.

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

    def hessians(self, x: Array, step: Step) -> list[Blocks | csc_matrix]:
        """∂²P/∂x², term by term."""
        return hessians(self.potentials, x, step, convex=False)

    def directions(self) -> Directions:
        """Newton's, for one step; along convex neighbours where steps end at a velocity."""
        return Directions(self.potentials, self.system, convex=self.velocity_tolerance > 0)

    def residual(self, g: Array) -> float:
        """Root mean square acceleration [m/s²] that the forces g [V, 3] left over would cause on the free nodes."""
        free = self.system.free
        m = self.mass[free]
        return float(np.sqrt(np.sum(g[free] ** 2 / m[:, None]) / max(m.sum(), 1e-300)))

    def speed(self, dx: Array, step: Step) -> float:
        """Root mean square of dx/h on the free nodes [m/s]."""
        free = self.system.free
        return float(np.sqrt(np.mean(np.sum(dx[free] ** 2, 1)))) / step.h


def solve(problem: Problem, x: Array, step: Step, *, boundary_target: Array) -> Solution:
    """Minimise from x [V, 3], which is free of contact with the collider at step.collider_n; boundary_target [B, 3] m."""
    directions = problem.directions()
    try:
        advance = _advance(problem, x, step, boundary_target, directions)
        if not advance.converged:
            return advance
        return minimise(problem, advance.x, step, advance.iterations, directions)
    except NotPositiveDefinite:
        return Solution(x, "the Hessian overflowed: the start is not finite or surfaces touch; see the frame before", 0, np.inf)


def _advance(problem: Problem, x: Array, step: Step, target: Array, directions: Directions) -> Solution:
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
        p = _answer(problem, x, here, Δb, Δc, directions)
        X, Y = surface.join(x, here.collider), surface.join(x + p, end)
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
                x, used = _relax(problem, x, here, directions)
                iterations += used


def _blocked(pair: str, left: float) -> str:
    return f"the prescribed motion is blocked with {1e3 * left:.2g} mm to go: {pair}; keep the collider apart there, or use more substeps"


def _answer(problem: Problem, x: Array, step: Step, Δb: Array, Δc: Array, directions: Directions) -> Array:
    """Newton step [V, 3] that foresees the motion Δ of what is prescribed."""
    fixed = np.zeros_like(x)
    fixed[problem.boundary] = Δb
    return directions.answer(x, step, problem.gradient(x, step), fixed, Δc)


def _relax(problem: Problem, x: Array, step: Step, directions: Directions) -> tuple[Array, int]:
    """A few plain Newton steps with everything prescribed held, so that gaps open again."""
    for iteration in range(3):
        x, moved, _ = _newton_step(problem, x, step, problem.gradient(x, step), directions, problem.energy(x, step))
        if moved > 0.5:
            return x, iteration + 1
    return x, 3


def minimise(problem: Problem, x: Array, step: Step, iterations: int = 0, directions: Directions | None = None) -> Solution:
    """From x [V, 3] where boundary and collider are at their targets already; `iterations` have been spent on that."""
    directions, before = directions or problem.directions(), np.inf
    tolerance = problem.tolerance * (FURTHER if directions.serve_again else 1)
    g, energy = problem.gradient(x, step), problem.energy(x, step)
    while True:
        residual = problem.residual(g)
        if residual <= tolerance:
            return Solution(x, CONVERGED, iterations, residual)
        if iterations >= problem.most_iterations:
            return Solution(x, _unfinished(problem, g, residual, iterations), iterations, residual)
        there = _step_again(problem, x, step, g, directions, energy) if residual < SERVES * before else None
        if there is None:
            there = _newton_step(problem, x, step, g, directions, energy)
            iterations += 1
            if there.share == 0:
                return Solution(x, _unfinished(problem, g, residual, iterations), iterations, residual)
            if problem.speed(there.x - x, step) < problem.velocity_tolerance * there.share:
                return Solution(there.x, CONVERGED, iterations, residual)
        g_there = problem.gradient(there.x, step)
        directions.learn(there.x - x, g_there - g)
        x, g, energy, before = there.x, g_there, there.energy, residual


class _Reached(NamedTuple):
    """x [V, 3] after a step, the share of it that was taken, and the energy there [J]."""

    x: Array
    share: float
    energy: float


def _newton_step(problem: Problem, x: Array, step: Step, g: Array, directions: Directions, energy: float) -> _Reached:
    """From x [V, 3], where gradient and energy are these."""
    return _along(problem, x, step, g, directions.newton(x, step, g), energy)


def _step_again(problem: Problem, x: Array, step: Step, g: Array, directions: Directions, energy: float) -> _Reached | None:
    """The same by the last factor; None where there is none, or the step cannot be taken whole."""
    p = directions.again(g)
    there = None if p is None else _along(problem, x, step, g, p, energy)
    return there if there is not None and there.share == 1 else None


def _along(problem: Problem, x: Array, step: Step, g: Array, p: Array, energy: float) -> _Reached:
    """Along p [V, 3], as far as nothing touches and the energy falls."""
    surface = problem.surface
    X, Y = surface.join(x, step.collider), surface.join(x + p, step.collider)
    share = surface.free_step(X, Y)
    slope = float(np.sum(g * p))
    while share > 1e-8:
        y = x + share * p
        there = problem.energy(y, step)
        # once the promised change drowns in rounding, the energy can no longer judge the step
        if there - energy <= 1e-4 * share * slope or -slope < 1e-11 * abs(energy):
            return _Reached(y, share, there)
        share /= 2
    return _Reached(x, 0.0, energy)


def _unfinished(problem: Problem, g: Array, residual: float, iterations: int) -> str:
    free = problem.system.free
    worst = free[int(np.argmax(np.sum(g[free] ** 2, 1) / problem.mass[free] ** 2))]
    return (
        f"Newton stopped after {iterations} iterations at a residual of {residual:.3g} m/s² (tolerance {problem.tolerance:.3g}), "
        f"worst at vertex {worst}; use more substeps or loosen acceleration_tolerance"
    )
