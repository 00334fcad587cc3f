"""The pixels that appearance is fitted to: linear, away from the mask's border, optionally reduced.

The mask is eroded by 2 px before anything else (PhysAvatar supplement A.4): its border is the least certain part of a matte. Reduction
averages d × d blocks in linear light, and a block is usable when all its pixels are.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from tasks.appearance.colour import linear_from_srgb
from tasks.geometry.cameras import Cameras
from tasks.geometry.faults import Fault, refuse

Images = Callable[[int, int], NDArray[np.uint8]]  # (frame, camera) -> [height, width, 3] sRGB
Masks = Callable[[int, int], NDArray]  # (frame, camera) -> [height, width], bool or in [0, 1]

OPAQUE = 0.999  # [-] least matte value that counts as the person
EROSION = 2  # [px] supplement A.4


def observe(images: Images, masks: Masks, frame: int, camera: int, *, reduce: int = 1) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Linear image [height/reduce, width/reduce, 3] and its usable pixels, of an 8-bit sRGB picture and its mask.

    Raises BadInput if they do not fit together.
    """
    matte, codes = np.asarray(masks(frame, camera)), np.asarray(images(frame, camera))
    if codes.shape != (*matte.shape, 3) or codes.dtype != np.uint8:
        found = f"image {codes.shape} {codes.dtype}, mask {matte.shape}"
        refuse([Fault(f"frame {frame}, camera {camera}", found, "Give an 8-bit RGB image and a mask of its size.")])
    usable, image = erode(matte > OPAQUE, EROSION), linear_from_srgb(codes)
    if reduce == 1:
        return image, usable
    height, width = usable.shape
    blocks = height // reduce, reduce, width // reduce, reduce
    return image.reshape(*blocks, 3).mean((1, 3)), usable.reshape(blocks).all((1, 3))


def erode(mask: NDArray[np.bool_], pixels: int) -> NDArray[np.bool_]:
    """The mask without what lies within `pixels` of its border (square neighbourhood); the edge of the image is no border."""
    return binary_erosion(mask, np.ones((3, 3), bool), iterations=pixels, border_value=1)


def camera_faults(cameras: Cameras, reduce: int) -> list[Fault]:
    """Cameras that the pixel model cannot draw: with distortion, or of a size that `reduce` does not divide."""
    if reduce < 1:
        return [Fault("reduce", f"is {reduce}", "Give a whole factor, 1 to leave the images as they are.")]
    faults = []
    for name, size, distortion in zip(cameras.names, cameras.size, cameras.distortion, strict=True):
        if np.abs(distortion).max() > 0:
            faults.append(Fault(f"camera {name}", f"distortion {distortion.tolist()}", "Undistort images, masks and calibration first."))
        if (size % reduce).any():
            faults.append(
                Fault(f"camera {name}", f"{size[0]} × {size[1]} px is not a multiple of {reduce}", "Choose another reduction or crop.")
            )
    return faults
