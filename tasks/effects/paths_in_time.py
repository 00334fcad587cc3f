"""What moves, looked at earlier or later than it was recorded."""

import numpy as np
from scipy.interpolate import CubicSpline

from tasks.simulator.potential import Array


def later(path: Array, frames: float) -> Array:
    """path [T, N, 3] m, at each frame where it is `frames` frames later: a cubic spline in time, straight on beyond its ends."""
    T = len(path)
    if not frames or T < 2:
        return path
    spline, t = CubicSpline(np.arange(T), np.eye(T)), np.arange(T) + frames
    inside = np.clip(t, 0, T - 1)
    weights = spline(inside) + (t - inside)[:, None] * spline(inside, 1)
    return np.tensordot(weights, path, 1)
