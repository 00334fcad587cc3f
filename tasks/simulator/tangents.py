"""Forward sensitivities: ∂x/∂θ and ∂v/∂θ of every step, by back-substitution with the exact Hessian at its end.

    Σ ∇P(x; history, θ) = 0   ⇒   H dx_free = −( ∂²P/∂x∂θ + ∂∇P/∂(history) d(history) ),    dv = (dx − dx̂)/s

A start that had to be freed from the collider is the minimum of such a sum, too, and so is differentiated alike; its velocity stays.

Lagged quantities (friction's normal force and tangent plane) count as history, so the derivative goes through the lag.
Source: implicit function theorem; Kane et al. 2000 for the rule. Limits: first order, along the contact history of the base run.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from tasks.simulator.linear_system import NotPositiveDefinite
from tasks.simulator.newton import Problem
from tasks.simulator.potential import Blocks, Step, StepTangent, sparse_times
from tasks.simulator.time_integration import Rule, State

Array = NDArray[np.float64]
Modes = Mapping[str, tuple[Array, Array]]
CARRIED = ("dx", "dv", "dc", "dx_before", "dv_before", "dc_before")


class Tangents:
    """Columns dx, dv [P, V, 3] of parameters (by name), start modes and M motion modes, carried along with the steps; dc [M, C, 3] of the collider."""

    def __init__(self, problem: Problem, names: tuple[str, ...], modes: Modes, motions: Modes, start: State) -> None:
        """Raises KeyError when no term has a parameter of that name."""
        for name in names:
            if not any(name in p.parameters for p in problem.potentials):
                known = sorted({n for p in problem.potentials for n in p.parameters})
                raise KeyError(f"no term has the parameter {name!r}; there are {', '.join(known)}")
        self.problem, self.parameters = problem, names
        self.names = (*names, *modes, *motions)
        shape = (len(self.names), *start.x.shape)
        self.dx, self.dv = np.zeros(shape), np.zeros(shape)
        for i, (dx0, dv0) in enumerate(modes.values(), len(names)):
            self.dx[i], self.dv[i] = dx0, dv0
        self._motions = tuple(motions.values())
        self.dx[:, problem.boundary], self.dv[:, problem.boundary] = 0, 0
        self.dx[self._moving, problem.boundary] = self._prescribed(0, 0.0, 1, len(problem.boundary))
        self.dc = self._prescribed(0, 0.0, 0, len(start.collider))
        self.dx_before, self.dv_before, self.dc_before = self.dx, self.dv, self.dc

    @property
    def _moving(self) -> slice:
        """The columns that move what is prescribed: the last ones."""
        return slice(len(self.names) - len(self._motions), None)

    @property
    def columns(self) -> dict[str, Array]:
        """All that `advance` moves on, by name."""
        return {name: getattr(self, name) for name in CARRIED}

    def take(self, columns: Mapping[str, Array]) -> None:
        """Go on from these columns."""
        for name in CARRIED:
            setattr(self, name, columns[name])

    def named(self) -> dict[str, tuple[Array, Array]]:
        """name -> (dx, dv) [V, 3]."""
        return {name: (self.dx[i], self.dv[i]) for i, name in enumerate(self.names)}

    def advance(self, x: Array, step: Step, rule: Rule, *, frame: int, share: float) -> None:
        """Through one step that ended at x [V, 3], at `share` of the way from frame − 1 to `frame`."""
        hat_x, hat_v = rule.hat(self.dx, self.dx_before), rule.hat(self.dv, self.dv_before)
        dc = self._prescribed(frame, share, 0, step.collider.shape[0])
        d = StepTangent(self.dx, self.dv, hat_x, hat_v, dc, self.dc, rule.hat(self.dc, self.dc_before))
        dx = self._answer(self.problem, x, step, d, self._fixed(frame, share))
        for potential in self.problem.potentials:
            potential.accept_tangent(x, step, dx, d, self.names)
        self.dx_before, self.dv_before, self.dc_before = self.dx, self.dv, self.dc
        self.dx, self.dv, self.dc = dx, (dx - hat_x) / step.s, dc

    def free(self, x: Array, held: Problem, step: Step) -> None:
        """Through the freeing of the start, which ended at x [V, 3]; held: what moved it and what held it in its place."""
        still = np.zeros_like(self.dx)
        d = StepTangent(self.dx, still, self.dx, still, self.dc, self.dc, self.dc)
        self.dx = self.dx_before = self._answer(held, x, step, d, self._fixed(0, 0.0))

    def _answer(self, problem: Problem, x: Array, step: Step, d: StepTangent, fixed: Array) -> Array:
        """dx [P, V, 3] of what a step minimised, at its end x [V, 3]; fixed [M, V, 3]: of the prescribed nodes."""
        hessians, system = problem.hessians(x, step), problem.system
        rhs = self._forces(problem, x, step, d)
        rhs[self._moving] -= _times(hessians, fixed)
        dx = system.scatter(_solve(system, system.assemble(hessians), system.gather(rhs).T).T)
        dx[self._moving] += fixed
        return dx

    def _forces(self, problem: Problem, x: Array, step: Step, d: StepTangent) -> Array:
        """−∂²P/∂x∂θ − ∂∇P/∂(history)·d [P, V, 3]."""
        rhs = np.zeros_like(self.dx)
        for potential in problem.potentials:
            history = potential.history_gradient(x, step, d)
            if history is not None:
                rhs -= history
            for i, name in enumerate(self.parameters):
                if name in potential.parameters:
                    rhs[i] -= potential.parameter_gradient(name, x, step)
        return rhs

    def _fixed(self, frame: int, share: float) -> Array:
        """Derivatives [M, V, 3] of the prescribed nodes, by the modes of the motion."""
        fixed = np.zeros((len(self._motions), *self.dx.shape[1:]))
        fixed[:, self.problem.boundary] = self._prescribed(frame, share, 1, len(self.problem.boundary))
        return fixed

    def _prescribed(self, frame: int, share: float, which: int, count: int) -> Array:
        """Derivatives [M, count, 3] of the collider (which = 0) or boundary (1) on the way from frame − 1 to frame, by the modes of the motion."""
        out = np.zeros((len(self._motions), count, 3))
        for i, motion in enumerate(self._motions):
            way = motion[which]
            out[i] = (1 - share) * way[frame - 1] + share * way[frame] if frame else way[0]
        return out


def _times(hessians: Sequence[Blocks | csc_matrix], fixed: Array) -> Array:
    """Answer [M, V, 3] of the free nodes' forces to a motion of the prescribed ones."""
    total = np.zeros_like(fixed)
    if len(fixed):
        n = fixed[0].size
        for H in hessians:
            total += H.times(fixed) if isinstance(H, Blocks) else sparse_times(H[:n, :n], fixed)
    return total


def _solve(system, A, b: Array) -> Array:
    """A⁻¹ b; by LU where the step ended on a saddle."""
    try:
        return system.factorise(A).solve(b)
    except NotPositiveDefinite:
        from scipy.sparse import tril
        from scipy.sparse.linalg import splu

        lower = tril(A)
        return splu((lower + tril(lower, -1).T).tocsc()).solve(np.ascontiguousarray(b))
