"""The state in which a tracked garment enters the simulation: position as tracked, velocity from the first frames."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FRAMES = 5  # a parabola through these; two frames would turn 1 mm of noise into 35 mm/s


def start_velocity(observed: Array, fps: float) -> Array:
    """Velocity [V, 3] m/s at frame 0: slope of the parabola through the first frames of observed [T, V, 3] m; 0 where they are not all seen."""
    n = min(FRAMES, len(observed))
    t = np.arange(n) / fps
    basis = np.stack([t**k for k in range(min(3, n))], 1)
    slope = np.tensordot(np.linalg.pinv(basis)[1], np.nan_to_num(observed[:n]), 1)
    return np.where(np.isfinite(observed[:n]).all((0, 2))[:, None], slope, 0.0)
