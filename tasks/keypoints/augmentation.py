"""What a training picture goes through on its way to the network: another view of it, another camera, something in the way.

Turn ±30°, scale 0.75–1.25, shift, mirror; gain, contrast, colour cast, grey; blur, noise, JPEG; rectangles of noise; a black border, as
where a crop hangs over the edge of its picture.
"""

from __future__ import annotations

import cv2
import numpy as np

from tasks.keypoints.crop import INPUT_SIZE, map_forth


def augmented(
    image: np.ndarray,
    keypoints: np.ndarray,
    visible: np.ndarray,
    flip: np.ndarray,
    random: np.random.Generator,
    *,
    size: tuple[int, int] = INPUT_SIZE,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A random view of a picture [320,256,3] with keypoints [133,2], visible [133]: (crop uint8 of `size`, keypoints, visible)."""
    matrix = _random_view(image.shape[1::-1], size, random)
    mirrored = random.random() < 0.5
    if mirrored:
        matrix = np.array([[-1, 0, size[0]], [0, 1, 0]]) @ np.vstack([matrix, [0, 0, 1]])
    shifted = matrix.copy()
    shifted[:, 2] += matrix[:, :2] @ [0.5, 0.5] - 0.5
    border = cv2.BORDER_CONSTANT if random.random() < 0.5 else cv2.BORDER_REFLECT_101
    crop = cv2.warpAffine(image, shifted, size, flags=cv2.INTER_LINEAR, borderMode=border)
    keypoints = map_forth(keypoints, matrix)
    if mirrored:
        keypoints, visible = keypoints[flip], visible[flip]
    crop, hidden = _obstructed(crop, keypoints, random)
    return _photographed(crop, random), keypoints, visible & ~hidden


def centred(image: np.ndarray, keypoints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The middle 192 x 256 of a picture as it is: what the detector sees when its box is right."""
    corner = (np.array(image.shape[1::-1]) - INPUT_SIZE) // 2
    return image[corner[1] : corner[1] + INPUT_SIZE[1], corner[0] : corner[0] + INPUT_SIZE[0]], keypoints - corner


def _random_view(picture: tuple[int, int], size: tuple[int, int], random: np.random.Generator) -> np.ndarray:
    angle = np.deg2rad(np.clip(random.normal(0, 14), -30, 30))
    s = size[0] / INPUT_SIZE[0] * np.exp(random.uniform(np.log(0.75), np.log(1.25)))
    if random.random() < 0.06:  # only a part of the body in view
        s *= random.uniform(1.3, 2.0)
    A = s * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    shift = random.normal(0, 0.05, 2) * size
    return np.column_stack([A, np.array(size) / 2 + shift - A @ (np.array(picture) / 2)])


def _obstructed(crop: np.ndarray, keypoints: np.ndarray, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    hidden = np.zeros(len(keypoints), bool)
    height, width = crop.shape[:2]
    if random.random() < 0.25:
        for _ in range(random.integers(1, 4)):
            low = random.uniform(-0.1, 1, 2) * (width, height)
            high = low + width * np.exp(random.uniform(np.log(0.04), np.log(0.4), 2))
            a, b = np.clip(low, 0, (width, height)).astype(int), np.clip(high, 0, (width, height)).astype(int)
            patch = crop[a[1] : b[1], a[0] : b[0]]
            patch[:] = random.integers(0, 256, 3) if random.random() < 0.6 else random.integers(0, 256, patch.shape)
            hidden |= ((keypoints >= a) & (keypoints < b)).all(1)
    if random.random() < 0.08:
        depth = int(random.uniform(0.03, 0.35) * height)
        side = random.integers(4)
        edge = [np.s_[:depth], np.s_[-depth:], np.s_[:, :depth], np.s_[:, -depth:]][side]
        crop[edge] = 0
        hidden |= [keypoints[:, 1] < depth, keypoints[:, 1] >= height - depth, keypoints[:, 0] < depth, keypoints[:, 0] >= width - depth][
            side
        ]
    return crop, hidden


def _photographed(crop: np.ndarray, random: np.random.Generator) -> np.ndarray:
    x = crop.astype(np.float32)
    if random.random() < 0.8:
        cast = 1 + random.normal(0, 0.1, 3)
        mean = x.mean()
        x = (mean + (x - mean) * random.uniform(0.6, 1.4)) * random.uniform(0.65, 1.4) * cast.astype(np.float32)
    if random.random() < 0.15:
        x = np.repeat(x.mean(2, keepdims=True), 3, axis=2)
    if random.random() < 0.3:
        x = cv2.GaussianBlur(x, (0, 0), random.uniform(0.4, 2.0) * crop.shape[1] / INPUT_SIZE[0])
    if random.random() < 0.15:
        length = 3 + int(random.integers(0, 7) * crop.shape[1] / INPUT_SIZE[0])
        kernel = np.zeros((length, length), np.float32)
        kernel[length // 2 if random.random() < 0.5 else slice(None), :] = 1
        kernel = np.eye(length, dtype=np.float32) if random.random() < 0.3 else kernel
        x = cv2.filter2D(x, -1, kernel / kernel.sum())
    if random.random() < 0.3:
        x += random.uniform(2, 16) * random.standard_normal(x.shape, np.float32)
    x = np.clip(x, 0, 255).astype(np.uint8)
    if random.random() < 0.2:
        x = cv2.imdecode(cv2.imencode(".jpg", x, [cv2.IMWRITE_JPEG_QUALITY, int(random.integers(25, 80))])[1], cv2.IMREAD_COLOR)
    return x
