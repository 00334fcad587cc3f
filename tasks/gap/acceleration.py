"""Residual acceleration: the force per mass [m/s²] that is missing at every vertex.

In a window that starts from a corrected state, what is missing moves a vertex by ½ a t². a is the least-squares fit of that parabola to a field
of displacements over the window; its standard deviation from the noise is σ/√Σ(½t²)².

Source: weak-constraint forcing (Trémolet 2006), constant over a window. Limits: cloth spreads a force to its neighbours within the window.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.shooting import Evidence
from tasks.gap.hypotheses import Fitted

Array = NDArray[np.float64]


def fitted_acceleration(displacement: Array, fps: float) -> Array:
    """a [V, 3] m/s² of displacements [L, V, 3] m at 1/fps … L/fps after the start; NaN frames left out."""
    b = 0.5 * (np.arange(1, len(displacement) + 1) / fps) ** 2
    known = np.isfinite(displacement)
    weight = np.sum(np.where(known, b[:, None, None] ** 2, 0.0), 0)
    total = np.sum(np.where(known, b[:, None, None] * np.nan_to_num(displacement), 0.0), 0)
    return np.where(weight > 0, total / np.maximum(weight, 1e-30), np.nan)


def residual_acceleration(evidence: Sequence[Evidence], fps: float) -> Array:
    """Root mean square over windows of what is missing at each vertex [V] m/s²."""
    return _rms([fitted_acceleration(e.residual, fps) for e in evidence if e.prediction.complete])


def effect_acceleration(evidence: Sequence[Evidence], named: Fitted, fps: float) -> Array:
    """The same of what the named effects add, at their estimated strengths [V] m/s²."""
    fields = [sum(θ * e.prediction.columns[c] for c, θ in named.strengths.items()) for e in evidence if e.prediction.complete]
    return _rms([fitted_acceleration(d, fps) for d in fields])


def _rms(a: Sequence[Array]) -> Array:
    squared = np.sum(np.stack(a) ** 2, -1)
    known = np.isfinite(squared)
    return np.sqrt(np.where(known, squared, 0.0).sum(0) / np.maximum(known.sum(0), 1))
