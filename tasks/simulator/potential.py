"""The one interface of everything that acts on cloth: a term P(x | history, θ) of the incremental potential.

A step of the implicit rule  x = x̂ + s v,  v = v̂ + s a  (x̂, v̂ known, s = ∂x/∂v) makes the sum of all terms stationary, Σ ∇P(x) = 0 [N].
Inertia is the term ½‖x − x̃‖²_M / s² with x̃ = x̂ + s v̂; a conservative energy enters as itself; a dissipation D(v) [W] enters as P =
s·D((x − x̂)/s), because ∂P/∂x is then the force ∂D/∂v; a force without potential enters lagged, as −f(history)·x. Hence all Hessians
are symmetric.

Source: Kane et al. 2000 (variational integrators with dissipation); Li et al. 2020 (IPC), eq. 4, generalised here to any linear
multistep rule.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

Array = NDArray[np.float64]
Indices = NDArray[np.int32]


@dataclass(frozen=True)
class Step:
    """What is known before x [V, 3] is: x_n, v_n, the rule (h, s, x_hat, v_hat), and the collider before, after and as its own x̂ [C, 3]."""

    h: float
    s: float
    x_n: Array
    v_n: Array
    x_hat: Array
    v_hat: Array
    collider: Array
    collider_n: Array
    collider_hat: Array
    time: float = 0.0

    @property
    def x_tilde(self) -> Array:
        """Where the nodes go without force [V, 3]."""
        return self.x_hat + self.s * self.v_hat

    def velocity(self, x: Array) -> Array:
        """v = (x − x̂)/s [V, 3] m/s."""
        return (x - self.x_hat) / self.s


@dataclass(frozen=True)
class StepTangent:
    """Directional derivatives of what `Step` knows, for K columns at once: cloth fields [K, V, 3]; collider fields [M, C, 3] of the last M
    columns, for the others do not move the collider.
    """

    x_n: Array
    v_n: Array
    x_hat: Array
    v_hat: Array
    collider: Array
    collider_n: Array
    collider_hat: Array


@dataclass(frozen=True)
class Blocks:
    """A Hessian as dense blocks on small stencils: stencils [K, m] vertices, values [K, 3m, 3m] N/m (order: vertex, then axis)."""

    stencils: Indices
    values: Array

    def times(self, dx: Array) -> Array:
        """Product with columns dx [P, V, 3] -> [P, V, 3]."""
        return _block_product(self.stencils, self.values, dx)


@njit(cache=True, nogil=True, error_model="numpy")
def _block_product(stencils, values, dx):
    total = np.zeros_like(dx)
    K, m = stencils.shape
    for p in range(len(dx)):
        for k in range(K):
            for a in range(m):
                for i in range(3):
                    force = 0.0
                    for b in range(m):
                        for j in range(3):
                            force += values[k, 3 * a + i, 3 * b + j] * dx[p, stencils[k, b], j]
                    total[p, stencils[k, a], i] += force
    return total


def sparse_times(H: csc_matrix, dx: Array) -> Array:
    """Product of a matrix [3A, 3B] with columns dx [P, B, 3] -> [P, A, 3]; of few vertices in contact few rows and columns have entries,
    and only those are multiplied.
    """
    rows, columns = np.unique(H.indices), np.flatnonzero(np.diff(H.indptr))
    out = np.zeros((len(dx), H.shape[0] // 3, 3))
    if len(dx) and len(rows):
        out.reshape(len(dx), -1)[:, rows] = (H[rows][:, columns] @ dx.reshape(len(dx), -1)[:, columns].T).T
    return out


NO_STIFFNESS = Blocks(np.empty((0, 1), np.int32), np.empty((0, 3, 3)))


class Potential(Protocol):
    """One term. `parameters` names the θ that `parameter_gradient` can differentiate with respect to.

    `memory` names the attributes that `begin`, `accept` and `accept_tangent` set: arrays that are replaced, never written into.
    """

    parameters: tuple[str, ...] = ()
    memory: tuple[str, ...] = ()

    def energy(self, x: Array, step: Step) -> float:
        """P(x) [J]."""
        ...

    def gradient(self, x: Array, step: Step) -> Array:
        """∂P/∂x [V, 3] N (minus the force)."""
        ...

    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks | csc_matrix:
        """∂²P/∂x²: exact, or with `convex` a positive semi-definite neighbour.

        A sparse matrix covers cloth and collider, [3(V+C), 3(V+C)].
        """
        ...

    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        """∂²P/∂x∂θ [V, 3] for the parameter called `name`."""
        raise KeyError(name)

    def history_gradient(self, x: Array, step: Step, d: StepTangent) -> Array | None:
        """∂∇P/∂(history)·d [K, V, 3] at fixed x; None where the term knows no history."""
        return None

    def begin(self, x: Array) -> None:
        """The motion begins at x [V, 3]: a term with a memory starts it, without derivatives."""

    def accept(self, x: Array, step: Step) -> None:
        """The step is kept and ended at x [V, 3]: a term with a memory moves it on. Steps that are tried in vain are never accepted."""

    def accept_tangent(self, x: Array, step: Step, dx: Array, d: StepTangent, names: tuple[str, ...]) -> None:
        """Move the derivatives of the memory on, given dx [K, V, 3] of the step's end; the columns are called `names`. Comes before `accept`."""
