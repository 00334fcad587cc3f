"""From rendered radiance to the files of a recording: sRGB JPEG without background, and a mask that is not perfect.

Every camera has its own colour gain. The mask is the coverage displaced by smooth noise of about a pixel, as automatic matting leaves
it: m = [blur(coverage) + n > ½]. Outside the mask the picture is black. Noise is drawn from a seed of camera and frame, so a picture
can be made again to the bit.
"""

import io

import numpy as np
from numpy.typing import NDArray

from tasks.capture.demo.textures import noise

Array = NDArray[np.float64]

GAIN_SPREAD = 0.02  # standard deviation of the logarithm, per camera and channel
BLUR = 1.0  # [px] of the coverage
RAGGED, WANDER = 0.15, 6.0  # noise added to the blurred coverage and its correlation length [px]: shifts the edge by about half a pixel
QUALITY = 95


def draw_gains(cameras: int, rng: np.random.Generator) -> Array:
    """Colour gains [camera, 3] of linear light, around 1."""
    return np.exp(rng.normal(0, GAIN_SPREAD, (cameras, 3)))


def develop(radiance: NDArray[np.float32], coverage: NDArray[np.float32], gain: Array, rng: np.random.Generator) -> tuple[bytes, bytes]:
    """JPEG of the picture and PNG of its mask, from linear radiance [height, width, 3] and coverage [height, width]."""
    from scipy.ndimage import gaussian_filter

    mask = gaussian_filter(coverage.astype(float), BLUR) + RAGGED * noise(coverage.shape, WANDER, rng) * (coverage.max() > 0) > 0.5
    mask &= gaussian_filter((coverage > 0).astype(float), 2 * BLUR) > 0.05  # no islands away from the actor
    grey = np.rint(255 * encode(np.clip(radiance * gain, 0, 1))).astype(np.uint8)
    return _jpeg(np.where(mask[..., None], grey, 0).astype(np.uint8)), _png(np.where(mask, 255, 0).astype(np.uint8))


def encode(linear: Array) -> Array:
    """sRGB transfer function (IEC 61966-2-1) of values in [0, 1]."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)


def _jpeg(rgb: NDArray[np.uint8]) -> bytes:
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(rgb).save(file, "JPEG", quality=QUALITY)
    return file.getvalue()


def _png(grey: NDArray[np.uint8]) -> bytes:
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(grey).save(file, "PNG")
    return file.getvalue()
