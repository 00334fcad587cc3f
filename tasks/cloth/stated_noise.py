"""The noise that a file of tracked geometry states: one standard deviation [m] of a coordinate per vertex and frame.

    σ = √(tr Σ / 3) where there are covariances Σ, else noise_m, else 1 mm

Where a vertex was not seen nobody knows its noise, and trackers write NaN there: it gets the median of those seen, so that medians over all
are theirs.
Limits: what a covariance says of directions is used where residuals are whitened (`scene.py`), not here.
"""

import numpy as np
from numpy.typing import NDArray

from tasks.capture.tracked_geometry import TrackedGeometry

Array = NDArray[np.float64]

NOISE_M = 1e-3  # where the file gives none
LEAST_M = 1e-5  # a file that states less, or none, would give every other error infinite weight
LEAST_TRACE = 1e-10  # [m²]


def noise_of(track: TrackedGeometry) -> Array:
    """[T, V] m."""
    if track.noise_cov is not None:
        noise = np.sqrt(np.maximum(np.trace(track.noise_cov, axis1=2, axis2=3), LEAST_TRACE) / 3)
    elif track.noise_m is not None:
        noise = np.maximum(track.noise_m, LEAST_M)
    else:
        return np.full(track.vertices.shape[:2], NOISE_M)
    return of_seen(noise, track.observed & np.isfinite(track.vertices).all(2))


def of_seen(noise: Array, seen: NDArray[np.bool_]) -> Array:
    """The noise [T, V] m, where a vertex was not `seen` [T, V] the median of those that were."""
    return np.where(seen, noise, np.median(noise[seen]) if seen.any() else NOISE_M)
