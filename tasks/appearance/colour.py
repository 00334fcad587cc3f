"""sRGB and linear light (IEC 61966-2-1).

Images on disk are 8-bit sRGB; light adds up in linear values, so everything between reading and writing is linear in [0, 1].
"""

import numpy as np
from numpy.typing import NDArray

_CODES = np.arange(256) / 255
_LINEAR_OF_CODE = np.where(_CODES <= 0.04045, _CODES / 12.92, ((_CODES + 0.055) / 1.055) ** 2.4).astype(np.float32)


def linear_from_srgb(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Linear values in [0, 1], any shape, of 8-bit sRGB codes."""
    return _LINEAR_OF_CODE[image]


def srgb_from_linear(linear: NDArray) -> NDArray[np.float64]:
    """sRGB values in [0, 1] of linear ones, which are clipped to [0, 1] first."""
    c = np.clip(linear, 0, 1)
    return np.where(c <= 0.0031308, 12.92 * c, 1.055 * c ** (1 / 2.4) - 0.055)


def srgb8_from_linear(linear: NDArray) -> NDArray[np.uint8]:
    """8-bit sRGB codes of linear values."""
    return np.rint(255 * srgb_from_linear(linear)).astype(np.uint8)
