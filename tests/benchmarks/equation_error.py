"""Fabric by equation error: the κ_s and κ_b whose forces balance best at recorded frames. Nothing is simulated.

    r_k(κ) = M⁻¹ ∂P_k/∂x(x_{k+1}; κ),      minimise Σ_k n_k log ‖r_k(κ)‖²

over the steps k of backward Euler from recorded frames k−1, k, each with a scale of its own that is not known: r [m/s²] is the acceleration
that the model leaves over, linear in κ, on free nodes. Where the recording is another simulator's, exact but for the tolerance at which its
steps stopped, this is where its errors are: in the balance of forces, not in places, which a step that ends on its way out of a saddle may
miss by a millimetre. It is of no use for tracked cloth: a millimetre of noise at 25 frames per second is an acceleration of 1 m/s², and of
a hundred in what the membrane answers.

Source: equation error against output error, Ljung 1999 (System Identification), § 7.2.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.simulator import Cloth, Collider, Fabric, Settings
from tasks.simulator.base_model import base_problem
from tasks.simulator.time_integration import State, known, rule

Array = NDArray[np.float64]
NAMES = ("log_membrane", "log_bending")
ROUNDS = 100


@dataclass(frozen=True)
class Balance:
    """Acceleration r [n] m/s² left over in one step, and its derivatives J [n, 2] by log κ_s, log κ_b."""

    r: Array
    J: Array


def balances(cloth: Cloth, fabric: Fabric, collider: Collider, x: Array, c: Array, *, fps: float, settings: Settings) -> list[Balance]:
    """Of every step k between frames x [T, V, 3] m, collider c [T, C, 3] m, with a fabric."""
    problem, h = base_problem(cloth, fabric, collider, c[0], settings=settings), 1 / fps
    free, found = problem.system.free, []
    for k in range(1, len(x) - 1):
        now = State(x[k], (x[k] - x[k - 1]) / h, c[k])
        step = known(rule("backward_euler", h, None), now, now, c[k + 1], h)
        g = problem.gradient(x[k + 1], step)
        by = [sum(p.parameter_gradient(n, x[k + 1], step) for p in problem.potentials if n in p.parameters) for n in NAMES]
        r, *J = ((force / problem.mass[:, None])[free].ravel() for force in (g, *by))
        found.append(Balance(r, np.stack(J, 1)))
    return found


def fitted(fabric: Fabric, steps: Sequence[Balance]) -> Fabric:
    """The fabric of least Σ n log ‖r‖², by least squares weighted anew until it stands still. `steps` are linearised at `fabric`, about
    which r is linear in κ.

    Raises RuntimeError when it does not stand still.
    """
    δ = np.zeros(len(NAMES))  # κ/κ_0 − 1
    for _ in range(ROUNDS):
        weight = [1 / np.mean((s.r + s.J @ δ) ** 2) for s in steps]
        A = sum(w * s.J.T @ s.J for w, s in zip(weight, steps, strict=True))
        b = sum(w * s.J.T @ s.r for w, s in zip(weight, steps, strict=True))
        before, δ = δ, -np.linalg.solve(A, b)
        if np.abs(δ - before).max() < 1e-9:
            return replace(fabric, membrane=fabric.membrane * (1 + δ[0]), bending=fabric.bending * (1 + δ[1]))
    raise RuntimeError(f"the weights do not settle within {ROUNDS} rounds")
