"""From a box in a picture to the network's input and back.

    u_crop = s (u − centre) + size/2,   s = 1 / (padding · max(box_width/width, box_height/height))

One isotropic scale, so that angles survive. All coordinates have the centre of the first pixel at (0.5, 0.5). A picture that is
shrunk is low-passed first (cv2.warpAffine alone would alias). Outside the picture is black.
"""

from __future__ import annotations

import cv2
import numpy as np

INPUT_SIZE = (192, 256)  # width, height [px] of the bundled network
PADDING = 1.25
MEAN = (123.675, 116.28, 103.53)  # ImageNet, RGB; kept so that RTMPose preprocessing serves the bundled network unchanged
STD = (58.395, 57.12, 57.375)


def crop_matrix(box: np.ndarray, size: tuple[int, int], *, padding: float = PADDING) -> np.ndarray:
    """Affine map [2,3] from picture px to crop px for a box (left, top, right, bottom) px and a crop of `size` (width, height)."""
    left, top, right, bottom = box
    s = 1 / (padding * max((right - left) / size[0], (bottom - top) / size[1]))
    return np.array([[s, 0, size[0] / 2 - s * (left + right) / 2], [0, s, size[1] / 2 - s * (top + bottom) / 2]])


def warp(image: np.ndarray, matrix: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """The picture [height,width,3] under `matrix` [2,3], `size` (width, height), without aliasing."""
    corners = map_back(np.array([[0, 0], [size[0], 0], [0, size[1]], size], float), matrix)
    margin = 4 / np.sqrt(abs(np.linalg.det(matrix[:, :2]))) + 2
    low = np.maximum(np.floor(corners.min(0) - margin), 0).astype(int)
    high = np.minimum(np.ceil(corners.max(0) + margin), image.shape[1::-1]).astype(int)
    if (high <= low).any():
        return np.zeros((size[1], size[0], 3), image.dtype)
    part = image[low[1] : high[1], low[0] : high[0]]
    shrink = 1 / np.sqrt(abs(np.linalg.det(matrix[:, :2])))
    if shrink > 1.2:
        part = cv2.GaussianBlur(part, (0, 0), 0.45 * np.sqrt(shrink**2 - 1))
    shifted = matrix.copy()
    shifted[:, 2] += matrix[:, :2] @ (low + 0.5) - 0.5  # OpenCV counts from pixel centres
    return cv2.warpAffine(part, shifted, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)


def map_forth(uv: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Picture px [...,2] -> crop px."""
    return uv @ matrix[:, :2].T + matrix[:, 2]


def map_back(uv: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Crop px [...,2] -> picture px."""
    return (uv - matrix[:, 2]) @ np.linalg.inv(matrix[:, :2]).T


def normalised(crops: np.ndarray) -> np.ndarray:
    """RGB [...,height,width,3] uint8 -> [...,3,height,width] float32 by the ImageNet mean and deviation."""
    return np.moveaxis((crops - np.float32(MEAN)) / np.float32(STD), -1, -3).astype(np.float32)
