"""Reading SimCC outputs: the sub-pixel peak of two one-dimensional distributions per keypoint.

    b* = argmax_b s_b,   δ = (s₋ − s₊) / (2 (s₋ − 2 s₀ + s₊)),   u = (b* + δ) / split + ½

Li et al., "SimCC" (2022); parabola through the peak and its neighbours (exact to second order). ½ because RTMPose counts columns from
the centre of the first pixel, this project from its left edge. The score is the smaller of the two peaks.
"""

from __future__ import annotations

import numpy as np


def decode(simcc_x: np.ndarray, simcc_y: np.ndarray, *, split: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    """Keypoints [...,point,2] px of the crop (centre of the first pixel = 0.5) and scores [...,point] from [...,point,bin] each."""
    x, peak_x = _peak(simcc_x)
    y, peak_y = _peak(simcc_y)
    return np.stack([x, y], -1) / split + 0.5, np.minimum(peak_x, peak_y)


def unflip(simcc_x: np.ndarray, simcc_y: np.ndarray, flip: np.ndarray, *, split: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    """Outputs for the mirrored crop -> outputs as if for the crop itself; `flip` [point] is the partner of each keypoint.

    Column c of the mirrored crop is column width−1−c, so bin b becomes bin split·(width−1)−b; the last split−1 bins have no source.
    """
    shift = round(split) - 1
    back = np.roll(simcc_x[..., ::-1], -shift, axis=-1)
    if shift:
        back[..., -shift:] = back[..., -shift - 1 : -shift]
    return back[..., flip, :], simcc_y[..., flip, :]


def _peak(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    b = s.argmax(-1)
    at = lambda k: np.take_along_axis(s, np.clip(b + k, 0, s.shape[-1] - 1)[..., None], -1)[..., 0].astype(float)  # noqa: E731
    left, top, right = at(-1), at(0), at(1)
    curvature = left - 2 * top + right
    inner = (b > 0) & (b < s.shape[-1] - 1) & (curvature < 0)
    δ = np.where(inner, (left - right) / np.where(inner, 2 * curvature, 1.0), 0.0)
    return b + δ, top
