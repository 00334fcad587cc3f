"""Colour gain of each camera against the others, from surface points that several of them see.

A pixel of camera k that sees texel t under irradiance A shows g_k ρ_t A. Per camera and coarse texel m_kt = Σ y A / Σ A² estimates
g_k ρ_t, and with γ = log g, r = log ρ

    min over γ, r of  Σ n_kt (log m_kt − γ_k − r_t)²,   Σ_k γ_k = 0          n_kt: pixels

is solved directly, channel by channel, after r is eliminated (the alternation of texture and gains needs tens of passes).
Gauge: the geometric mean over the cameras is 1; a common factor is in the texture. Limits: groups of cameras that share no texel
have a mean of 1 each; A comes from a grey mesh.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from tasks.appearance.pixels import View

Array = NDArray[np.float64]

COARSE = (64, 64)  # [texel] views for this are drawn with a texture of this size
DARKEST = 1e-3  # [-] m below this has no useful logarithm in 8 bits


def camera_gains(pictures: Iterable[tuple[int, View, NDArray[np.float32], NDArray[np.bool_]]], camera_count: int) -> Array:
    """Gains [camera, 3] from (camera, view drawn for COARSE texels, linear image, usable pixels); 1 for cameras without pictures."""
    cross, own, count = (np.zeros((camera_count, 3, COARSE[0] * COARSE[1])) for _ in range(3))
    for k, view, image, usable in pictures:
        at = usable & (view.face[::2, ::2] >= 0)
        column, row = np.moveaxis(np.rint(view.texel[::2, ::2][at]).astype(int), -1, 0)
        texel = np.clip(row, 0, COARSE[0] - 1) * COARSE[1] + np.clip(column, 0, COARSE[1] - 1)
        A, y = view.irradiance[::2, ::2][at], image[at]
        for c in range(3):
            for total, value in ((cross, y[:, c] * A[:, c]), (own, A[:, c] ** 2), (count, np.ones(len(y)))):
                total[k, c] += np.bincount(texel, value, minlength=total.shape[2])
    m = cross / np.maximum(own, 1e-12)
    return np.stack([np.exp(_log_gains(m[:, c], np.where(m[:, c] > DARKEST, count[:, c], 0))) for c in range(3)], 1)


def _log_gains(m: Array, n: Array) -> Array:
    """γ [camera] of m, n [camera, texel]: (diag Σ_t n − n diag(1/Σ_k n) nᵀ) γ = Σ_t n (log m − mean of it over cameras)."""
    seen = np.maximum(n.sum(0), 1e-12)
    y = np.log(np.maximum(m, DARKEST))
    b = (n * (y - (n * y).sum(0) / seen)).sum(1)
    # the shortest solution: mean 0 within each group of cameras that share texels, 0 for a camera without pictures
    return np.linalg.lstsq(np.diag(n.sum(1)) - (n / seen) @ n.T, b, rcond=1e-9)[0]
