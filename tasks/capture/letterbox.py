"""Videos whose pictures were shrunk and padded with black to another size than the calibration's.

A picture of (w₀, h₀) scaled by s = min(w/w₀, h/h₀) and centred in (w, h) obeys  u = s u₀ + (w − s w₀)/2,  v alike, in half-integer pixel
centres where scaling about the corner needs no offset. The pictures are left alone: K follows them instead, since distortion acts before
K.

Accepted only when the black bands are seen where the formula puts them, to `TOLERANCE` rows; any other difference in size is the caller's
fault.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

TOLERANCE = 1.0  # rows; a band ends within a pixel, and codecs blur it over two


@dataclass(frozen=True)
class Letterbox:
    """u = scale u₀ + offset; `bands` (left, right, top, bottom) are the black columns and rows counted in the pictures."""

    scale: float
    offset: NDArray[np.float64]
    bands: tuple[int, int, int, int]

    def lens(self, K: NDArray[np.float64]) -> NDArray[np.float64]:
        """K [3, 3] of the calibrated picture, for the padded one."""
        return np.array([[self.scale, 0, self.offset[0]], [0, self.scale, self.offset[1]], [0, 0, 1]]) @ K


def find_letterbox(pictures: NDArray[np.uint8], calibrated: tuple[int, int]) -> Letterbox | None:
    """The mapping for pictures [frame, height, width, 3] of a camera calibrated at (width, height); None where no padding explains them."""
    h, w = pictures.shape[1:3]
    s = min(w / calibrated[0], h / calibrated[1])
    offset = (np.array([w, h]) - s * np.array(calibrated)) / 2
    bands = black_bands(pictures)
    expected = offset.repeat(2)
    padded = expected.max() >= TOLERANCE  # else the picture is merely scaled, and dark margins are its own
    return Letterbox(s, offset, bands) if not padded or np.abs(np.array(bands) - expected).max() <= TOLERANCE else None


def black_bands(pictures: NDArray[np.uint8]) -> tuple[int, int, int, int]:
    """Columns at the left and right, rows at the top and bottom, that are black in all pictures [frame, height, width, 3].

    Black is what stays, at its 90th percentile, below half of the middle row's: codecs smear bright pictures well into a band.
    """
    level = pictures.max(axis=(0, 3))
    lit = [profile >= np.median(profile) / 2 for profile in (np.percentile(level, 90, axis=0), np.percentile(level, 90, axis=1))]
    return tuple(int(np.argmax(end)) for side in lit for end in (side, side[::-1]))
