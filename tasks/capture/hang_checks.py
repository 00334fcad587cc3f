"""Whether free cloth hangs the way gravity pulls: the upward axis of a file, judged by its garment.

d, from the mean of the driven vertices to that of the others, points down where cloth hangs. A body may hold it up (a sleeve on a stretched
arm), so with a collider this is only worth a warning. Without one nothing else can: cloth that in every frame of a quarter of a second
leans further than `LEANING` from the vertical hangs in a file whose axes are not what they are said to be.
"""

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.faults import Fault

UP = {"y": 1, "z": 2}
LEANING = 0.3  # cosine between d and down: 73 degrees
LONG_ENOUGH = 0.25  # [s]: in free fall 0.3 m
NEAR = 0.15  # of the garment's extent: where d is shorter, cloth hangs on all sides
REMEDY = 'Set up to the vertical axis ("y" or "z"), and turn the file so that it points upwards.'


def hang_faults(arrays: dict[str, np.ndarray], name: str) -> list[Fault]:
    """Of arrays that are sound by themselves."""
    cosine = _hang(arrays)
    if "collider_vertices" in arrays or not len(cosine) or cosine.max() >= LEANING:
        return []
    return [Fault(f"{name}: up", _said(arrays, cosine), REMEDY)]


def hang_warnings(arrays: dict[str, np.ndarray], name: str) -> list[str]:
    """The same where a body may be the reason."""
    cosine = _hang(arrays)
    return [f"{name}: up: {_said(arrays, cosine)}. {REMEDY}"] if len(cosine) and cosine.mean() < LEANING else []


def _said(arrays: dict[str, np.ndarray], cosine: NDArray[np.float64]) -> str:
    lean = np.degrees(np.arccos(cosine.mean()))
    return f"is {arrays.get('up', 'y')!s}, but free cloth hangs {lean:.0f} degrees away from downwards"


def _hang(arrays: dict[str, np.ndarray]) -> NDArray[np.float64]:
    """Cosine between d and down in each frame in which most of the garment is known; empty where that is not long enough to judge by."""
    x, driven = arrays.get("vertices"), arrays.get("boundary", np.zeros(0, int))
    axis = UP.get(str(arrays.get("up", "y")))
    if x is None or not len(driven) or len(driven) == x.shape[1] or axis is None:
        return np.zeros(0)
    free = np.setdiff1d(np.arange(x.shape[1]), driven)
    known = np.isfinite(x).all(2)
    shown = (known[:, free].mean(1) > 0.5) & known[:, driven].all(1)
    if not shown.any():
        return np.zeros(0)
    x = x[shown].astype(float)
    d = np.nanmean(x[:, free], 1) - x[:, driven].mean(1)
    extent = (np.nanmax(x, 1) - np.nanmin(x, 1)).max(1)
    length = np.linalg.norm(d, axis=1)
    far = length > NEAR * extent
    return -d[far, axis] / length[far] if far.sum() >= LONG_ENOUGH * float(arrays["fps"]) else np.zeros(0)
