"""Forward sensitivities: ∂x/∂θ and ∂v/∂θ of every step, by back-substitution with the exact Hessian at its end.

    Σ ∇P(x; history, θ) = 0   ⇒   H dx_free = −( ∂²P/∂x∂θ + ∂∇P/∂(history) d(history) ),    dv = (dx − dx̂)/s

Lagged quantities (friction's normal force and tangent plane) count as history, so the derivative goes through the lag.
Source: implicit function theorem; Kane et al. 2000 for the rule. Limits: first order, along the contact history of the base run.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from tasks.simulator.linear_system import NotPositiveDefinite
from tasks.simulator.newton import Problem
from tasks.simulator.potential import Step, StepTangent
from tasks.simulator.time_integration import Rule, State

Array = NDArray[np.float64]


class Tangents:
    """Columns dx, dv [P, V, 3] of parameters (by name) and start modes, carried along with the steps."""

    def __init__(self, problem: Problem, names: tuple[str, ...], modes: Mapping[str, tuple[Array, Array]], start: State) -> None:
        """Raises KeyError when no term has a parameter of that name."""
        for name in names:
            if not any(name in p.parameters for p in problem.potentials):
                known = sorted({n for p in problem.potentials for n in p.parameters})
                raise KeyError(f"no term has the parameter {name!r}; there are {', '.join(known)}")
        self.problem, self.parameters = problem, names
        self.names = (*names, *modes)
        shape = (len(self.names), *start.x.shape)
        self.dx, self.dv = np.zeros(shape), np.zeros(shape)
        for i, (dx0, dv0) in enumerate(modes.values(), len(names)):
            self.dx[i], self.dv[i] = dx0, dv0
            self.dx[i][problem.boundary] = self.dv[i][problem.boundary] = 0
        self.dx_before, self.dv_before = self.dx, self.dv
        self._still = np.zeros((len(self.names), *start.collider.shape))

    def named(self) -> dict[str, tuple[Array, Array]]:
        """name -> (dx, dv) [V, 3]."""
        return {name: (self.dx[i], self.dv[i]) for i, name in enumerate(self.names)}

    def advance(self, x: Array, step: Step, rule: Rule) -> None:
        """Through one step that ended at x [V, 3]."""
        problem, system = self.problem, self.problem.system
        hat_x, hat_v = rule.hat(self.dx, self.dx_before), rule.hat(self.dv, self.dv_before)
        d = StepTangent(self.dx, self.dv, hat_x, hat_v, self._still, self._still, self._still)
        rhs = np.zeros_like(self.dx)
        for potential in problem.potentials:
            history = potential.history_gradient(x, step, d)
            if history is not None:
                rhs -= history
            for i, name in enumerate(self.parameters):
                if name in potential.parameters:
                    rhs[i] -= potential.parameter_gradient(name, x, step)
        A = system.assemble(problem.hessians(x, step, convex=False))
        dx = system.scatter(_solve(system, A, system.gather(rhs).T).T)
        self.dx_before, self.dv_before = self.dx, self.dv
        self.dx, self.dv = dx, (dx - hat_x) / step.s


def _solve(system, A, b: Array) -> Array:
    """A⁻¹ b; by LU where the step ended on a saddle."""
    try:
        return system.factorise(A).solve(b)
    except NotPositiveDefinite:
        from scipy.sparse import tril
        from scipy.sparse.linalg import splu

        lower = tril(A)
        return splu((lower + tril(lower, -1).T).tocsc()).solve(np.ascontiguousarray(b))
