"""The spectrum of a residual within windows: how much of it is an offset, and how much moves at which frequency.

Every window starts anew, so frequencies below 1/(its length) do not exist; what is slower is the offset. By Parseval's theorem the squares
of the figures add up to the mean squared distance. White noise of σ per coordinate puts 3σ²·(lines per band)/L into each.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FEWEST_FRAMES = 4


@dataclass(frozen=True)
class Spectrum:
    """frequency [K] Hz (0: the window's offset), rms [K] mm of a vertex in that band, and of white noise [K] mm."""

    frequency: Array
    rms_mm: Array
    noise_mm: Array


def spectrum(fields: Sequence[Array], fps: float, noise: float) -> Spectrum | None:
    """Of residuals [L, V, 3] m of windows, those of the commonest length; noise [m] of a coordinate. None where windows are too short."""
    length = Counter(len(f) for f in fields).most_common(1)[0][0] if fields else 0
    if length < FEWEST_FRAMES:
        return None
    whole = [f[:, np.isfinite(f).all((0, 2))] for f in fields if len(f) == length]
    vertices = sum(f.shape[1] for f in whole)
    if not vertices:
        return None
    lines = np.full(length // 2 + 1, 2.0)
    lines[0] = 1
    if length % 2 == 0:
        lines[-1] = 1
    power = sum((np.abs(np.fft.rfft(f, axis=0)) ** 2).sum((1, 2)) for f in whole) * lines / length**2 / vertices
    return Spectrum(np.fft.rfftfreq(length, 1 / fps), 1e3 * np.sqrt(power), 1e3 * np.sqrt(3 * noise**2 * lines / length))
