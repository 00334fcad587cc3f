"""95 % intervals of shares and of means."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Z = 1.959964
RESAMPLES = 2000


def wilson(successes: float, count: int) -> tuple[float, float]:
    """Wilson's interval of a share; successes may be fractional (partial credit)."""
    if not count:
        return 0.0, 1.0
    p, n = successes / count, count
    centre = (p + Z**2 / (2 * n)) / (1 + Z**2 / n)
    half = Z / (1 + Z**2 / n) * np.sqrt(p * (1 - p) / n + Z**2 / (4 * n**2))
    low, high = centre - half, centre + half  # exactly 0 where none succeeded, but for rounding
    return (float(max(low, 0.0)) if successes else 0.0), (float(min(high, 1.0)) if successes < count else 1.0)


def bootstrap(values: Array, statistic=np.mean, seed: int = 0) -> tuple[float, float]:
    """Percentile interval of a statistic of values [N], cases drawn with replacement; (nan, nan) of nothing."""
    values = np.asarray(values, float)
    if not len(values):
        return float("nan"), float("nan")
    draws = np.random.default_rng(seed).integers(len(values), size=(RESAMPLES, len(values)))
    low, high = np.quantile([statistic(values[d]) for d in draws], [0.025, 0.975])
    return float(low), float(high)
