"""What a window's normal equations marginalise: its uncertain start state, and nameless forcing.

    C_w = R + S_z P S_zᵀ,    P = diag(σ_x², σ_v², σ_a²)

Nameless forcing has no part in the base refit: it would take for itself what stiffness explains. It enters, with σ_a in P, where causes are
weighed (`shooting.Job.forced`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.windows import Normals, columns_of, marginalised

Array = NDArray[np.float64]
NUISANCES = ("x ", "v ", "a ")  # how names of columns begin that are marginalised: start state and forcing


@dataclass(frozen=True)
class Prior:
    """Standard deviations of smooth modes: σ_x [m] and σ_v [m/s] of a start state; σ_a [m/s²] of the forcing."""

    x: float
    v: float
    a: float = 0.0

    def variances(self, names: Sequence[str]) -> Array:
        """One per state column."""
        return np.array([self.x**2 if name.startswith("x ") else self.v**2 for name in names])


def state_names(names: Sequence[str]) -> list[str]:
    """Columns of the start state."""
    return [*columns_of(names, "x "), *columns_of(names, "v ")]


def state_weights(n: Normals, z: Sequence[str], columns: Sequence[str], variances: Array) -> Array:
    """Posterior mean [Z, 1 + C] of the start state's coefficients z, of variances [Z] before, that explains the residual, and each of the columns."""
    i = n.index(z)
    H = n.G[np.ix_(i, i)] + np.diag(1 / variances)
    return np.linalg.solve(H, np.column_stack([n.g[i], n.G[np.ix_(i, n.index(columns))]]))


def without_nuisances(normals: Normals, prior: Prior) -> Normals:
    """Normal equations with start state and forcing marginalised."""
    return without_forcing(without_state(normals, prior), prior.a)


def without_forcing(normals: Normals, σ_a: float) -> Normals:
    """Normal equations with a forcing of size σ_a [m/s²] marginalised; as they are where there is none."""
    a = list(columns_of(normals.names, "a "))
    return marginalised(normals, a, np.full(len(a), σ_a**2)) if a else normals


def without_state(normals: Normals, prior: Prior) -> Normals:
    """Normal equations with the start state marginalised; the forcing keeps its columns."""
    z = state_names(normals.names)
    return marginalised(normals, z, prior.variances(z))
