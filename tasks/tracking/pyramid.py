"""Blurred images of one instant, all cameras, with the mask as fourth channel.

Level σ holds G_σ * (R, G, B, mask), sampled every s = 2^⌊log₂(σ/2)⌋ pixels (at least 1): boxes of s × s pixels are averaged, then blurred.
Pixel (i, j) covers [i, i + 1) × [j, j + 1), so a point at u in the image is at u/s in its level.

`look_up` reads a level by uniform cubic B-splines: twice differentiable, its gradient is the derivative of its value. The spline and
the box blur too (variances 1/3 and (1 − s⁻²)/12 of a level's squared pixel); the Gaussian makes up the rest of σ².

Colours are premultiplied by the mask: what is behind the actor is black in every view. Images of distorted cameras are first resampled to
the distortion-free camera with the same K.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tasks.geometry.cameras import Cameras

Images = Callable[[int, int], NDArray]
"""(frame, camera) -> [height, width, 3] uint8 or floats in [0, 1]; masks likewise [height, width]."""


@dataclass(frozen=True)
class Level:
    """Pixels of all cameras in one buffer [pixel, 4];
    camera k is rows offset[k] + j·width + i, of size[k] = (width, height), reduced by `scale`.
    """

    pixels: NDArray[np.float32]
    offset: NDArray[np.int64]
    size: NDArray[np.int64]
    scale: float
    blur: float


def stack(images: Images, masks: Images | None, frame: int, cameras: Cameras) -> list[NDArray[np.float32]]:
    """The images of one frame as float32 [height, width, 4] per camera: masked colour and mask."""
    return [_with_mask(images(frame, k), None if masks is None else masks(frame, k), cameras, k) for k in range(len(cameras))]


def level(stacked: list[NDArray[np.float32]], blur: float) -> Level:
    """One level of blur σ [px] of images [height, width, 4]."""
    import cv2

    scale = 2 ** max(int(np.floor(np.log2(blur / 2))), 0)
    σ = np.sqrt(max((blur / scale) ** 2 - 1 / 3 - (1 - scale**-2) / 12, 0.01))
    blurred = [cv2.GaussianBlur(_boxes(image, scale), (0, 0), σ, borderType=cv2.BORDER_REPLICATE) for image in stacked]
    size = np.array([(b.shape[1], b.shape[0]) for b in blurred], np.int64)
    offset = np.concatenate([[0], np.cumsum(size.prod(1))[:-1]])
    return Level(np.concatenate([b.reshape(-1, 4) for b in blurred]), offset, size, float(scale), blur)


@njit(inline="always")
def look_up(pixels, offset, width, height, u, v, value, du, dv):
    """Value and derivatives by (u, v) of one camera's level at (u, v) px, into value, du, dv [4]; outside, the border continues."""
    s, t = u - 0.5, v - 0.5
    i, j = int(np.floor(s)), int(np.floor(t))
    f, h = s - i, t - j
    a = ((1 - f) ** 3 / 6, (3 * f**3 - 6 * f**2 + 4) / 6, (-3 * f**3 + 3 * f**2 + 3 * f + 1) / 6, f**3 / 6)
    b = ((1 - h) ** 3 / 6, (3 * h**3 - 6 * h**2 + 4) / 6, (-3 * h**3 + 3 * h**2 + 3 * h + 1) / 6, h**3 / 6)
    da = (-((1 - f) ** 2) / 2, (3 * f**2 - 4 * f) / 2, (-3 * f**2 + 2 * f + 1) / 2, f**2 / 2)
    db = (-((1 - h) ** 2) / 2, (3 * h**2 - 4 * h) / 2, (-3 * h**2 + 2 * h + 1) / 2, h**2 / 2)
    for c in range(4):
        value[c], du[c], dv[c] = 0.0, 0.0, 0.0
    for q in range(4):
        row = offset + min(max(j - 1 + q, 0), height - 1) * width
        for p in range(4):
            place = row + min(max(i - 1 + p, 0), width - 1)
            wv, wu, wd = a[p] * b[q], da[p] * b[q], a[p] * db[q]
            for c in range(4):
                I = pixels[place, c]
                value[c] += wv * I
                du[c] += wu * I
                dv[c] += wd * I


def _with_mask(image: NDArray, mask: NDArray | None, cameras: Cameras, k: int) -> NDArray[np.float32]:
    rgb = image.astype(np.float32) / (255 if image.dtype == np.uint8 else 1)
    alpha = np.ones(rgb.shape[:2], np.float32) if mask is None else mask.astype(np.float32) / (255 if mask.dtype == np.uint8 else 1)
    four = np.dstack([rgb * alpha[..., None], alpha])
    return four if not cameras.distortion[k].any() else _undistorted(four, cameras.K[k], cameras.distortion[k])


def _undistorted(image: NDArray[np.float32], K: NDArray, distortion: NDArray) -> NDArray[np.float32]:
    import cv2

    centred = K - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]  # OpenCV has the centre of the first pixel at (0, 0)
    columns, rows = cv2.initUndistortRectifyMap(centred, distortion, None, centred, image.shape[1::-1], cv2.CV_32FC1)
    return cv2.remap(image, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


def _boxes(image: NDArray[np.float32], scale: int) -> NDArray[np.float32]:
    """Means over scale × scale pixels; the last row and column are repeated up to a whole number of boxes."""
    if scale == 1:
        return image
    height, width = image.shape[:2]
    padded = np.pad(image, ((0, -height % scale), (0, -width % scale), (0, 0)), mode="edge")
    h, w = padded.shape[0] // scale, padded.shape[1] // scale
    return padded.reshape(h, scale, w, scale, 4).mean((1, 3), dtype=np.float32)
