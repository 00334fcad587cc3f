"""How large the pattern is, or the cameras make it, is seen without any simulation: by how much longer than its rest shape cloth was
observed.

    s = √(Σ (|x_i − x_j|² − b)/Σ |X_i − X_j|²) − 1        over edges (i, j) and frames in which both ends were seen

b is what errors of tracking add, 3(σ_i² + σ_j²) − 6 ρK(|X_i − X_j|) σ_i σ_j, for what both ends share makes no edge longer
(`cloth/tracking_noise.py`); the share ρ may be off by `DOUBT`, and of all s that this allows the one nearest to zero counts. The simulator has
to be told: a base that lacks the scale bends its fabric until no derivative leads back (`afresh.py`).
Cloth stretches by its own weight and shortens in folds of a coarse mesh, by 0.1 to 0.5 % in seventeen cases whose scale was right; below
`LEAST` nothing is claimed.

Limits: needs a rest shape that is not the first frame's own; one scale for all directions.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.tracking_noise import Correlation
from tasks.cloth.windows import Recording
from tasks.effects.model import Model

Array = NDArray[np.float64]
SCALES = ("fabric_rest_scale", "observation_scale")  # one class: of several recordings of one garment either explains it
LEAST = 0.01
DOUBT = 0.15  # of the share of errors that neighbours have in common: half of the widest step between those that are tried


def observed_scale(model: Model, recordings: Sequence[Recording]) -> float:
    """s, zero where it is below `LEAST`."""
    cloth = model.subject.cloth
    corners = cloth.x_rest[cloth.faces] if cloth.uv is None else cloth.uv  # [F, 3, 2 or 3] m
    rest = np.sum((corners - np.roll(corners, -1, 1)) ** 2, -1)
    apart = np.linalg.norm(cloth.x_rest[cloth.faces] - cloth.x_rest[np.roll(cloth.faces, -1, 1)], axis=-1)
    observed = whole = 0.0
    added = np.zeros(2)
    for recording in recordings:
        x, σ = recording.observed[:, cloth.faces], recording.noise[:, cloth.faces]
        length2 = np.sum((x - np.roll(x, -1, 2)) ** 2, -1)
        seen = np.isfinite(length2)
        observed += float(length2[seen].sum())
        whole += float(np.broadcast_to(rest, length2.shape)[seen].sum())
        added += [float(b[seen].sum()) for b in _added(σ, np.roll(σ, -1, 2), apart, recording.correlation)]
    if not whole:
        return 0.0
    low, high = (float(np.sqrt(max(observed - b, 0.0) / whole)) - 1 for b in added)
    nearest = min(max(0.0, low), high)
    return nearest if abs(nearest) > LEAST else 0.0


def _added(σ_i: Array, σ_j: Array, apart: Array, correlation: Correlation) -> Iterator[Array]:
    """b [T, F, 3] m² of edges whose ends are `apart` [F, 3] m at rest, with the least share that is allowed and with the largest."""
    for share in np.clip([correlation.share - DOUBT, correlation.share + DOUBT], 0.0, 1.0):
        yield 3 * (σ_i**2 + σ_j**2) - 6 * replace(correlation, share=float(share)).between(apart) * σ_i * σ_j
