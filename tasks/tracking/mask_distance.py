"""How far a pixel lies from the outline of a mask, for the outline term and for the visual hull."""

import numpy as np
from numpy.typing import NDArray


def signed_distance(inside: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Distance [height, width] px to the outline of a mask [height, width], positive inside.

    Half a pixel is taken off: what is measured is the distance to the centre of the nearest pixel of the other kind.
    """
    return np.where(inside, _to_zero(inside) - 0.5, 0.5 - _to_zero(~inside)).astype(np.float32)


def _to_zero(pixels: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Distance [height, width] px of each pixel to the nearest one that is False."""
    import cv2

    found = cv2.distanceTransform(pixels.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE).astype(float)
    return np.sqrt(np.rint(found**2))  # OpenCV's last digit changes with the place of its buffers; squares of distances are whole numbers
