"""What a tracker makes of the truth: correlated noise, gaps, smoothing in time.

Noise: a white part and a part that is correlated over CORRELATED m of cloth and REMEMBERED s of time, half of the variance each.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
CORRELATED, REMEMBERED = 0.06, 0.12


def noise(rest: Array, frames: int, fps: float, sigma: float, rng: np.random.Generator, *, white: float = 0.5) -> Array:
    """Errors [T, V, 3] m of standard deviation `sigma` per coordinate; `white`: share of their variance without memory."""
    distance = np.linalg.norm(rest[:, None] - rest, axis=-1)
    L = np.linalg.cholesky(np.exp(-0.5 * (distance / CORRELATED) ** 2) + 1e-6 * np.eye(len(rest)))
    keep = np.exp(-1 / (fps * REMEMBERED))
    slow = np.empty((frames, len(rest), 3))
    slow[0] = L @ rng.normal(size=rest.shape)
    for t in range(1, frames):
        slow[t] = keep * slow[t - 1] + np.sqrt(1 - keep**2) * L @ rng.normal(size=rest.shape)
    return sigma * (np.sqrt(1 - white) * slow + np.sqrt(white) * rng.normal(size=slow.shape))


def dropouts(frames: int, rest: Array, share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Seen [T, V]: patches of cloth vanish for a few frames until about `share` of all is gone; the first two frames are whole."""
    seen = np.ones((frames, len(rest)), bool)
    while share and (~seen).mean() < share:
        centre, radius = rest[rng.integers(len(rest))], rng.uniform(0.04, 0.1)
        start = rng.integers(2, frames)
        gone = np.linalg.norm(rest - centre, axis=1) < radius
        seen[start : start + rng.integers(2, 9), gone] = False
    return seen


def smoothed(x: Array, fps: float, deviation: float) -> Array:
    """Average over time with a Gaussian of standard deviation [s]; beyond its ends the motion goes straight on."""
    if not deviation:
        return x
    n = int(np.ceil(4 * deviation * fps))
    k = np.arange(-n, n + 1)
    weight = np.exp(-0.5 * (k / (deviation * fps)) ** 2)
    weight /= weight.sum()
    before = x[0] - np.arange(n, 0, -1)[:, None, None] * (x[1] - x[0])
    after = x[-1] + np.arange(1, n + 1)[:, None, None] * (x[-1] - x[-2])
    long = np.concatenate([before, x, after])
    return sum(w * long[i : i + len(x)] for i, w in enumerate(weight))
