"""How large the pattern is, or the cameras make it, is seen without any simulation: by how much longer than its rest shape cloth was
observed.

    s = √(Σ (|x_i − x_j|² − b)/Σ |X_i − X_j|²) − 1        over edges (i, j) and frames in which both ends were seen

b is what errors of tracking add: 6σ² where neighbours err independently, nothing where they err together; of all s in between the one
nearest to zero. The simulator has to be told: a base that lacks the scale bends its fabric until no derivative leads back (`afresh.py`).
Cloth stretches by its own weight and shortens in folds of a coarse mesh, by 0.1 to 0.5 % in seventeen cases whose scale was right; below
`LEAST` nothing is claimed.

Limits: needs a rest shape that is not the first frame's own; one scale for all directions.
"""

from collections.abc import Sequence

import numpy as np

from tasks.cloth.windows import Recording
from tasks.effects.model import Model

SCALES = ("fabric_rest_scale", "observation_scale")  # one class: of several recordings of one garment either explains it
LEAST = 0.01


def observed_scale(model: Model, recordings: Sequence[Recording]) -> float:
    """s, zero where it is below `LEAST`."""
    cloth = model.subject.cloth
    corners = cloth.x_rest[cloth.faces] if cloth.uv is None else cloth.uv  # [F, 3, 2 or 3] m
    rest = np.sum((corners - np.roll(corners, -1, 1)) ** 2, -1)
    observed = noise = whole = 0.0
    for recording in recordings:
        x, σ2 = recording.observed[:, cloth.faces], recording.noise[:, cloth.faces] ** 2
        apart = np.sum((x - np.roll(x, -1, 2)) ** 2, -1)
        seen = np.isfinite(apart)
        observed += float(apart[seen].sum())
        noise += float(3 * (σ2 + np.roll(σ2, -1, 2))[seen].sum())
        whole += float(np.broadcast_to(rest, apart.shape)[seen].sum())
    if not whole:
        return 0.0
    low, high = (float(np.sqrt(max(observed - b, 0.0) / whole)) - 1 for b in (noise, 0.0))
    nearest = min(max(0.0, low), high)
    return nearest if abs(nearest) > LEAST else 0.0
