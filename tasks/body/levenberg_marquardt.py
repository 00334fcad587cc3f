"""Damped Gauss–Newton descent (Levenberg 1944; Marquardt 1963; damping rule of Nielsen 1999): (H + μ diag H) δ = −g.

Limits: dense matrices, hundreds of unknowns; finds the minimum of the basin it starts in.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tasks.body.model import Array

FLOOR = 1e-9  # of the largest diagonal entry: keeps unknowns that nothing depends on from dividing by zero


@dataclass(frozen=True)
class Minimum:
    """z [n], energy there, accepted steps, and how the descent ended."""

    z: Array
    energy: float
    steps: int
    converged: bool
    ending: str


def minimise(
    expand: Callable[[Array], tuple[float, Array, Array]],
    energy: Callable[[Array], float],
    z: Array,
    *,
    steps: int = 50,
    tolerance: float = 1e-5,
) -> Minimum:
    """Minimum from start z [n]; `expand` gives energy, gradient [n] and curvature [n,n].

    Ends when a step gains less than tolerance × energy, when no step gains anything, or after `steps`.
    """
    E, g, H = expand(z)
    μ, growth = 1e-3, 2.0
    for step in range(steps):
        D = np.maximum(np.diag(H), FLOOR * np.diag(H).max())
        for _ in range(20):
            δ = -np.linalg.solve(H + np.diag(μ * D), g)
            E_new, expected = energy(z + δ), -(g @ δ) - 0.5 * δ @ H @ δ
            if E_new < E:
                break
            μ, growth = μ * growth, 2 * growth
        else:
            return Minimum(z, E, step, True, f"converged after {step} steps: no descent left")
        μ, growth = μ * max(1 / 3, 1 - (2 * (E - E_new) / expected - 1) ** 3), 2.0
        gained, z = E - E_new, z + δ
        if gained < tolerance * E:
            return Minimum(z, E_new, step + 1, True, f"converged after {step + 1} steps")
        E, g, H = expand(z)
    return Minimum(z, E, steps, False, f"stopped at {steps} steps, the last gained {gained / E:.1e} of the energy")
