"""The colours of the surface samples, taken once, from frame 0, and never updated: nothing accumulates.

m is the mean over the cameras that see the sample from its better seen side, weighted by the facing cosine. At fine blur every camera
expects m. At coarse blur (more than 2 px) a camera that saw the sample expects ½ own + ½ m, because strong blur mixes in neighbours that
depend on the view. Samples that no camera saw in frame 0 are left out for good.

With `gain`, each camera's colour is first brought to the common one by c ↦ (c − offset)/gain, both from frame 0 by least squares on what
several cameras see, with mean gain 1 and mean offset 0 (the colours of the rig as a whole are not observable).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.cameras import Cameras
from tasks.tracking import photometric
from tasks.tracking.pyramid import Level
from tasks.tracking.surface import Surface

Array = NDArray[np.float64]

_FINE_PX = 2.0


@dataclass(frozen=True)
class Reference:
    """colour[level] [sample, camera, 4]; known [sample]; side [sample] (+1 outer, −1 inner)."""

    colour: tuple[NDArray[np.float32], ...]
    known: NDArray[np.bool_]
    side: NDArray[np.int8]


def better_side(cosine: NDArray[np.float32]) -> NDArray[np.int8]:
    """+1 where the outer side of a sample is seen at least as well as the inner, else −1 [sample]; cosine [sample, camera] signed."""
    return np.where(cosine.sum(1) >= 0, 1, -1).astype(np.int8)


def take(x: Array, surface: Surface, levels: list[Level], cameras: Cameras, cosine: NDArray[np.float32]) -> Reference:
    """Reference colours at vertices x [V, 3] m, given the signed cosines [sample, camera] of what is seen."""
    side = better_side(cosine)
    weight = np.maximum(cosine * side[:, None], 0)
    return Reference(tuple(_expected(x, surface, level, cameras, weight) for level in levels), weight.any(1), side)


def _expected(x: Array, surface: Surface, level: Level, cameras: Cameras, weight: NDArray[np.float32]) -> NDArray[np.float32]:
    own = photometric.colours(x, surface.faces, surface.barycentric, level=level, cameras=cameras, weight=weight)
    seen = weight > 0
    own[~seen] = 0
    total = np.maximum(weight.sum(1), 1e-12)
    mean = np.einsum("sk,skc->sc", weight, own) / total[:, None]
    share = np.where(seen & (level.blur > _FINE_PX), 0.5, 0.0).astype(np.float32)[..., None]
    return share * own + (1 - share) * mean[:, None]


def camera_gains(x: Array, surface: Surface, level: Level, cameras: Cameras, cosine: NDArray[np.float32]) -> tuple[Array, Array]:
    """Gain and offset [camera, 3] of each camera's colours against the mean of all, from samples that at least two cameras see.

    Each pass regresses own colours on the mean, c = gain·m + offset; three passes, since correcting the cameras changes m.
    """
    weight = np.maximum(cosine * better_side(cosine)[:, None], 0).astype(float)
    weight[(weight > 0).sum(1) < 2] = 0
    own = photometric.colours(x, surface.faces, surface.barycentric, level=level, cameras=cameras, weight=weight.astype(np.float32))[
        ..., :3
    ].astype(float)
    own[weight == 0] = 0
    gain, offset = np.ones((len(cameras), 3)), np.zeros((len(cameras), 3))
    for _ in range(3):
        m = np.einsum("sk,skc->sc", weight, (own - offset) / gain) / np.maximum(weight.sum(1), 1e-12)[:, None]
        for k in range(len(cameras)):
            gain[k], offset[k] = _line(weight[:, k], m, own[:, k])
        offset -= gain * (offset / gain).mean(0)
        gain /= gain.mean(0)
    return gain, offset


def corrected(level: Level, gain: Array, offset: Array) -> Level:
    """The level with each camera's colours brought to the common ones; what the mask leaves out stays black."""
    pixels = level.pixels.copy()
    for k, (width, height) in enumerate(level.size):
        rows = slice(level.offset[k], level.offset[k] + width * height)
        pixels[rows, :3] = (pixels[rows, :3] - offset[k] * pixels[rows, 3:]) / gain[k]
    return replace(level, pixels=pixels)


def _line(w: Array, m: Array, c: Array) -> tuple[Array, Array]:
    """Weighted regression c ≈ gain·m + offset per channel; gain 1, offset 0 where there is nothing to go by."""
    total = w.sum()
    if total == 0:
        return np.ones(3), np.zeros(3)
    m0, c0 = w @ m / total, w @ c / total
    variance = w @ (m - m0) ** 2 / total
    gain = np.where(variance > 1e-6, (w @ ((m - m0) * (c - c0)) / total) / np.maximum(variance, 1e-12), 1.0)
    return gain, c0 - gain * m0
