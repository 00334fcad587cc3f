"""What the coarse mesh alone feigns: strengths that a diagnosis would find on a recording of another mesh in which nothing is missing.

Three sources, added in quadrature: where the body holds cloth, and how long folded cloth is, as each effect says of itself (`Effect.feigned`); and the
finer re-run D, put in the place of the recording:

    θ_D = argmin Σ_w (D_w − S_w θ)ᵀ C_w⁻¹ (D_w − S_w θ) + prior

D is taken off every window with coefficient 1 ± 1 (`cloth/numerics.py`), but what is left of the discretisation is no multiple of D in each; over all
windows it asks for the same few dampings and drags, by about as much as D does.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.chord_shortening import chord_shortening
from tasks.cloth.contact_sagitta import body_speed
from tasks.cloth.shooting import PARAMETERS, without_forcing
from tasks.cloth.windows import Normals, columns_of
from tasks.effects.effect import Effect, MeshDoubt
from tasks.effects.model import Model
from tasks.gap.gathered import Gathered
from tasks.gap.hypotheses import FORCING, precision

Array = NDArray[np.float64]

Feigned = dict[str, float]


def mesh_doubt(model: Model, data: Gathered, contact_doubt: float) -> MeshDoubt:
    """What the coarse mesh leaves in doubt; contact_doubt [m]: where contact may hold the cloth wrongly."""
    scale = chord_shortening(model.subject.cloth, data.states, data.noise)
    return MeshDoubt(contact_doubt, body_speed(data.recordings, model.subject.fps), scale)


def feigned(effects: Sequence[Effect], doubt: MeshDoubt, normals: Sequence[Normals], σ_a: float) -> Feigned:
    """Column -> standard deviation of the strength that the mesh feigns; normals [W]: with columns of forcing (size σ_a [m/s²]) and "numerics"."""
    finer = [without_forcing(n, σ_a) for n in normals if "numerics" in n.names]
    found = {}
    for e in effects:
        own = np.hypot(e.feigned(doubt), _by_numerics(e, finer))
        found |= {c: float(σ) for c, σ in zip(e.columns, own, strict=True)}
    return found


def _by_numerics(effect: Effect, normals: Sequence[Normals]) -> Array:
    """|θ_D| [K]."""
    names = [*PARAMETERS, *effect.columns]
    A, b = np.diag(precision([effect])), np.zeros(len(names))
    for n in normals:
        i = n.index(names)
        A, b = A + n.G[np.ix_(i, i)], b + n.G[i, n.names.index("numerics")]
    return np.abs(np.linalg.solve(A, b)[len(PARAMETERS) :])


def numerics_forcing(normals: Sequence[Normals]) -> float:
    """σ_a [m/s²] that the finer re-run alone, seen with the recording's noise, would be taken for.

    The minimum over σ_a of E[rᵀC⁻¹r + log|C|] for r = D + ε, ε ~ N(0, R): with λ, U of S_aᵀR⁻¹S_a and h = Uᵀ S_aᵀR⁻¹D,

        Σ_w Σ_i log(1 + σ_a² λ_i) − σ_a² (λ_i + h_i²)/(1 + σ_a² λ_i)
    """
    losses = np.zeros(len(FORCING))
    for n in normals:
        a = n.index(list(columns_of(n.names, "a ")))
        if "numerics" in n.names and len(a):
            λ, U = np.linalg.eigh(n.G[np.ix_(a, a)])
            λ, h2 = np.maximum(λ, 0), (U.T @ n.G[a, n.names.index("numerics")]) ** 2
            σ2 = np.square(FORCING)[:, None]
            losses += np.sum(np.log1p(σ2 * λ) - σ2 * (λ + h2) / (1 + σ2 * λ), 1)
    return FORCING[int(np.argmin(losses))]
