"""How much doubt a fit leaves that the library holds the cause.

Odds are max(g, √(f g))^s, with s = `SHARPNESS`, of what the best hypothesis leaves

    g = max(E/(`ABOVE` E_0), ratio²/`ABOVE_REPLAYED`)     to be seen: a gap E [mm²] in windows, start states taken out, against the floor E_0 of
                                                          noise and finer re-run, or in whole recordings replayed (`replay.py`)
    f = σ_a²/k²                                           to be explained by forcing σ_a [m/s²] without a name, against what is known to be there:
                                                          k² = `NUMERICS` times what the finer re-run would be taken for, squared, and `TOLERATED`²

Forcing alone is no reason for doubt: where contact comes a little early it asks for metres per second squared, and nothing is seen of them.
What acts slowly shows in replays only. The constants are chosen on open cases (README).
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.nuisances import without_state
from tasks.cloth.shooting import Evidence
from tasks.gap.feigned import numerics_forcing
from tasks.gap.hypotheses import NOWHERE, Fitted
from tasks.gap.refits import Refitted
from tasks.gap.screening import Screened

Array = NDArray[np.float64]

NUMERICS = 1.5
TOLERATED = 0.4  # [m/s²] of forcing that proves nothing: a twenty-fifth of gravity
ABOVE = 2.5  # times the floor, in squares, that are even odds
ABOVE_REPLAYED = 4.0  # the same for replays
SHARPNESS = 2.0


def unexplained(screened: Screened, best: Fitted, simulated: Refitted | None, floor_mm: float, replayed: float) -> float:
    """Doubt in 0..1 that the library holds the cause. best: the hypothesis of most evidence; simulated: it, or its first effect,
    after its refit; replayed: E/E_0."""
    known = numerics_forcing([without_state(e.normals, screened.prior) for e in screened.evidence])
    forcing = best.forcing**2 / (NUMERICS * known**2 + TOLERATED**2)
    evidence, origin = screened.evidence, NOWHERE
    if simulated is not None and simulated.windows is not None:
        evidence, origin = simulated.evidence, simulated.windows.origin
    left = gap_left(evidence, best, origin)
    seen = np.nanmax([left**2 / (ABOVE * floor_mm**2), replayed / ABOVE_REPLAYED])
    odds = max(seen, np.sqrt(forcing * seen)) ** SHARPNESS
    return float(odds / (1 + odds))


def gap_left(evidence: Sequence[Evidence], fitted: Fitted, origin: Mapping[str, float] = NOWHERE) -> float:
    """√E [mm] that a hypothesis leaves, as far as derivatives about the simulated strengths `origin` tell."""
    left = [linear_rest(e, fitted, origin) for e in evidence if e.residual is not None]
    return float(1e3 * np.sqrt(np.nanmean(np.concatenate([np.sum(r**2, -1) for r in left]))))


def linear_rest(evidence: Evidence, fitted: Fitted, origin: Mapping[str, float] = NOWHERE) -> Array:
    """What effects at their strengths and the base's corrections leave of a window's residual [L, V, 3] m."""
    steps = dict(zip(PARAMETERS, fitted.base, strict=True)) | {c: θ - origin.get(c, 0.0) for c, θ in fitted.strengths.items()}
    return evidence.residual - sum(step * evidence.prediction.columns[c] for c, step in steps.items())
