"""What the coarse mesh alone feigns: strengths that a diagnosis would find on a recording of another mesh in which nothing is missing.

Three sources, added in quadrature: where the body holds cloth, and how long folded cloth is, as each effect says of itself
(`Effect.feigned`); and ways of computing that nobody thought of. Those that were thought of are integrated out (`cloth/numerics.py`); what
one more would feign is judged by what each of them would, were it not among them:

    θ_e = argmin Σ_w (D_ew − S_w θ)ᵀ C_w⁻¹ (D_ew − S_w θ) + prior,     C_w with all ways but e integrated out;     σ = median_e |θ_e|

A body that is held wrongly, or a fold that is too short, is no evidence for anything else either: what effects say of themselves is
integrated out of every window, another one in each (`without_doubts`).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.chord_shortening import chord_shortening
from tasks.cloth.contact_sagitta import body_speed
from tasks.cloth.nuisances import without_forcing
from tasks.cloth.numerics import WAYS, finer_shift, without_others
from tasks.cloth.windows import Normals, columns_of, marginalised
from tasks.effects.effect import Effect, MeshDoubt
from tasks.effects.model import Model
from tasks.gap.gathered import Gathered
from tasks.gap.hypotheses import FORCING
from tasks.gap.strength_priors import precision

Array = NDArray[np.float64]

Feigned = dict[str, float]

# frames²: τ² by which start states are smoothed in time; a replay seen with 4 mm of noise asked for 0.23, a null skirt for 0.05
CALMED = 0.25


def mesh_doubt(model: Model, data: Gathered, contact_doubt: float) -> MeshDoubt:
    """What the coarse mesh leaves in doubt; contact_doubt [m]: where contact may hold the cloth wrongly."""
    scale = chord_shortening(model.subject.cloth, data.states, data.noise)
    fps = model.subject.fps
    return MeshDoubt(contact_doubt, body_speed(data.recordings, fps), scale, CALMED / fps**2)


def feigned(effects: Sequence[Effect], doubt: MeshDoubt, normals: Sequence[Normals], σ_a: float) -> Feigned:
    """Column -> standard deviation of the strength that the mesh feigns; normals [W]: with columns of forcing (size σ_a [m/s²]) and of numerics."""
    each = {way: [without_forcing(without_others(n, way), σ_a) for n in normals if way in n.names] for way in WAYS}
    found = {}
    for e in effects:
        θ = [np.abs(_looks_like(e, own, way)) for way, own in each.items() if own]
        σ = np.hypot(e.feigned(doubt), np.median(θ, 0) if θ else 0.0)
        found |= {c: float(s) for c, s in zip(e.columns, σ, strict=True)}
    return found


def without_doubts(n: Normals, effects: Sequence[Effect], doubt: MeshDoubt) -> Normals:
    """Normal equations with what the mesh leaves in doubt integrated out, the effects' own columns kept."""
    σ = {c: s for e in effects for c, s in zip(e.columns, e.feigned(doubt), strict=True) if s > 0}
    if not σ:
        return n
    copies = [f"{c} in doubt" for c in σ]
    i = np.concatenate([np.arange(len(n.names)), n.index(list(σ))])
    both = replace(n, names=(*n.names, *copies), G=n.G[np.ix_(i, i)], g=n.g[i])
    return marginalised(both, copies, np.square(list(σ.values())))


def _looks_like(effect: Effect, normals: Sequence[Normals], way: str) -> Array:
    """θ [K] that what a way of computing changes would be taken for."""
    names = [*PARAMETERS, *effect.columns]
    A, b = np.diag(precision([effect])), np.zeros(len(names))
    for n in normals:
        i = n.index(names)
        A, b = A + n.G[np.ix_(i, i)], b + n.G[i, n.names.index(way)]
    return np.linalg.solve(A, b)[len(PARAMETERS) :]


def numerics_forcing(normals: Sequence[Normals]) -> float:
    """σ_a [m/s²] that what a finer computation adds, seen with the recording's noise, would be taken for.

    The minimum over σ_a of E[rᵀC⁻¹r + log|C|] for r = D + ε, ε ~ N(0, R): with λ, U of S_aᵀR⁻¹S_a and h = Uᵀ S_aᵀR⁻¹D,

        Σ_w Σ_i log(1 + σ_a² λ_i) − σ_a² (λ_i + h_i²)/(1 + σ_a² λ_i)
    """
    losses = np.zeros(len(FORCING))
    for n in normals:
        a = n.index(list(columns_of(n.names, "a ")))
        δ = finer_shift(n.names)
        if δ.any() and len(a):
            λ, U = np.linalg.eigh(n.G[np.ix_(a, a)])
            λ, h2 = np.maximum(λ, 0), (U.T @ n.G[a] @ δ) ** 2
            σ2 = np.square(FORCING)[:, None]
            losses += np.sum(np.log1p(σ2 * λ) - σ2 * (λ + h2) / (1 + σ2 * λ), 1)
    return FORCING[int(np.argmin(losses))]
