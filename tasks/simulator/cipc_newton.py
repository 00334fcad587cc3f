"""One step as C-IPC solves it: for comparison with its runs, where the place a step ends at depends on the way there.

C-IPC stops when Newton's step over h, root mean square, stays below a velocity for three iterations; a buckling cloth is then still leaving
a saddle, and how far it got is decided by the path. So the path is followed here: from x_n, every element's and pair's Hessian with its
negative eigenvalues cut off, the share of the step that additive collision detection leaves, then halving until the energy does not rise.

Prescribed nodes: if they can jump to their targets past the cloth at rest, they do. Otherwise a penalty on their distance pulls them until
99 % of the way is done; there they stay. Hence `Solution.collider` and the boundary of `Solution.x` may end short of their targets. Here
the target itself is asked for: the recordings show the penalty to be about 1e6 times the nodal mass, so that a ring that carries a skirt
stands 2e-6 to 5e-6 m beside it.

Source: the Newton loop of Codim-IPC (Li, Kaufman, Jiang 2021) as PhysAvatar runs it. Left out: gradient steps after a failed factorisation,
and the doubling of the barrier's stiffness for pairs closer than 1e-9 m. Limits: linear convergence, and an end that is not a solution; no
tangents.
"""

from collections import deque
from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from tasks.simulator.contact_surface import ContactSurface
from tasks.simulator.newton import CONVERGED, Problem, Solution
from tasks.simulator.newton_direction import times
from tasks.simulator.potential import Blocks, Step

Array = NDArray[np.float64]
CARRIED = 0.99  # share of the way at which prescribed nodes are left where they are
LAST = 3  # iterations that must all be slow
LEAST_SHARE = 1e-12


def solve(problem: Problem, x: Array, step: Step, *, boundary_target: Array) -> Solution:
    """From x [V, 3], free of contact with the collider at step.collider_n; boundary_target [B, 3] m."""
    x, here, pull = _begin(problem, x, step, boundary_target)
    whole = _remaining(problem, x, here, boundary_target, step.collider)
    speeds: deque[float] = deque(maxlen=LAST)
    energy = None
    for iteration in range(1, problem.most_iterations + 1):
        p, Δc = _direction(problem, x, here, boundary_target, step.collider, pull=pull)
        share = _free_share(problem.surface, x, p, here.collider, Δc)
        if pull:
            x, here = x + share * p, replace(here, collider=here.collider + share * Δc)
            pull = _remaining(problem, x, here, boundary_target, step.collider) > (1 - CARRIED) * whole
        else:
            energy = problem.energy(x, here) if energy is None else energy
            share, energy = _halved(problem, x, p, here, share, energy)
            x = x + share * p
        speeds.append(_speed(problem, p, Δc, step))
        if share < LEAST_SHARE:
            return Solution(x, f"the line search found no way down after {iteration} iterations", iteration, np.inf, here.collider)
        if not pull and len(speeds) == LAST and max(speeds) <= problem.velocity_tolerance:
            return Solution(x, CONVERGED, iteration, problem.residual(problem.gradient(x, here)), here.collider)
    return Solution(x, f"Newton stopped after {problem.most_iterations} iterations", problem.most_iterations, np.inf, here.collider)


def _begin(problem: Problem, x: Array, step: Step, target: Array) -> tuple[Array, Step, bool]:
    """x [V, 3] and the step as they stand before the first iteration, and whether prescribed nodes must still be pulled."""
    jumped = x.copy()
    jumped[problem.boundary] = target
    if _free_share(problem.surface, x, jumped - x, step.collider_n, step.collider - step.collider_n) < 1:
        return x, replace(step, collider=step.collider_n), True
    # friction's normal forces are taken after the jump
    return jumped, replace(step, x_n=jumped, collider_n=step.collider), False


def _direction(problem: Problem, x: Array, here: Step, target: Array, end: Array, *, pull: bool) -> tuple[Array, Array]:
    """Newton's step of the cloth [V, 3] and of the collider [C, 3]."""
    hessians = convex_hessians(problem, x, here)
    g, fixed, Δc = problem.gradient(x, here), np.zeros_like(x), np.zeros_like(end)
    if pull:
        fixed[problem.boundary], Δc = target - x[problem.boundary], end - here.collider
        g = g + times(hessians, fixed, Δc)
    factor = problem.system.factorise(problem.system.assemble(hessians))
    return problem.system.scatter(factor.solve(-problem.system.gather(g))) + fixed, Δc


def _free_share(surface: ContactSurface, x: Array, p: Array, collider: Array, Δc: Array) -> float:
    """Share of the step that leaves a tenth of every gap; asked only of pairs whose swept boxes touch, as C-IPC does."""
    X, Y = surface.join(x, collider), surface.join(x + p, collider + Δc)
    surface.prepare(X, Y)
    return surface.free_share_of(X, Y, surface.coming_near(X, Y, 0.0))


def _halved(problem: Problem, x: Array, p: Array, here: Step, share: float, energy: float) -> tuple[float, float]:
    """The share at which the energy is no higher than before, and that energy."""
    while True:
        there = problem.energy(x + share * p, here)
        if there <= energy or share < LEAST_SHARE:
            return share, there
        share /= 2


def _speed(problem: Problem, p: Array, Δc: Array, step: Step) -> float:
    """Root of the summed squares over h per free node [m/s]; the prescribed nodes' steps count too."""
    return float(np.sqrt((np.sum(p**2) + np.sum(Δc**2)) / len(problem.system.free))) / step.h


def _remaining(problem: Problem, x: Array, here: Step, target: Array, end: Array) -> float:
    """Distance [m] of all prescribed nodes from their targets."""
    return float(np.sqrt(np.sum((target - x[problem.boundary]) ** 2) + np.sum((end - here.collider) ** 2)))


def convex_hessians(problem: Problem, x: Array, step: Step) -> list[Blocks | csc_matrix]:
    """Every term's Hessian without the negative eigenvalues of its elements and pairs."""
    exact = [p.hessian(x, step, convex=False) for p in problem.potentials]
    pairs = zip(problem.potentials, exact, strict=True)
    return [Blocks(H.stencils, clamped(H.values)) if isinstance(H, Blocks) else p.hessian(x, step, convex=True) for p, H in pairs]


@njit(cache=True, nogil=True, error_model="numpy")
def clamped(H: Array) -> Array:
    """Blocks [K, n, n] with negative eigenvalues set to 0."""
    out = H.copy()
    for e in range(len(H)):
        if not _definite(H[e]):
            λ, v = np.linalg.eigh(H[e])
            out[e] = (v * np.maximum(λ, 0.0)) @ v.T
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _definite(H):
    """Whether H + ε I has a Cholesky factor: tells in a tenth of the time that there is nothing to cut off."""
    n = len(H)
    ε = 1e-12 * np.trace(H)
    L = np.zeros((n, n))
    for j in range(n):
        for i in range(j, n):
            s = H[i, j]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            if i == j:
                if s + ε <= 0:
                    return False
                L[j, j] = np.sqrt(s + ε)
            else:
                L[i, j] = s / L[j, j]
    return True
