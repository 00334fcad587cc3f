"""How like the recording a textured mesh looks: peak signal-to-noise ratio over the person.

Compared as sRGB in [0, 1], at mask pixels eroded by 2 px that the mesh covers in full and whose texels the images determine: what was
never seen is filled in by the solver's prior and would score the prior.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tasks.appearance.colour import srgb_from_linear
from tasks.appearance.observations import Images, Masks, observe
from tasks.appearance.pixels import sees_only, shade
from tasks.appearance.scene import Scene

Array = NDArray[np.float64]


def psnr(linear: NDArray, reference: NDArray, where: NDArray[np.bool_]) -> float:
    """−10 log₁₀ of the mean square difference [dB] of linear images [height, width, 3] as sRGB at `where`; NaN when that is empty."""
    if not where.any():
        return float("nan")
    return float(-10 * np.log10(np.mean((srgb_from_linear(linear[where]) - srgb_from_linear(reference[where])) ** 2)))


def score_views(
    scene: Scene,
    light: Sequence[NDArray[np.float32]],
    albedo: NDArray,
    observed: NDArray[np.bool_],
    images: Images,
    masks: Masks,
    *,
    frames: Sequence[int],
    reduce: int = 1,
    gain: Array | float = 1.0,
) -> Array:
    """PSNR [frame, camera] dB of every view of a scene whose frames are number `frames` in the recording; gain [camera, 3] or 1."""
    gain = np.broadcast_to(gain, (len(scene.cameras), 3))
    table = np.full((len(frames), len(scene.cameras)), np.nan)
    for i, frame in enumerate(frames):
        for k in range(len(scene.cameras)):
            image, usable = observe(images, masks, frame, k, reduce=reduce)
            view = scene.view(i, k, light[i], observed.shape)
            table[i, k] = psnr(shade(view, albedo)[0] * gain[k], image, usable & sees_only(view, observed))
    return table
