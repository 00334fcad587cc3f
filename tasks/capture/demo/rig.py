"""Calibrated cameras on a ring around the actor, a few of them higher up."""

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.cameras import Cameras

Array = NDArray[np.float64]

DISTANCE = 2.6  # [m] from the axis
FIELD = 2.15  # [m] of height seen at that distance
LOW, HIGH = 1.05, 2.1  # [m] heights of the cameras


def ring_cameras(count: int, size: int, target: Array, *, rng: np.random.Generator, portrait: int | None = None) -> Cameras:
    """`count` cameras of size × size px that look at target [3] m; every fourth stands higher. Mounts and lenses vary by a per cent or so.

    `portrait` turns that camera's picture upright: three quarters as wide as it is high.
    """
    turn = 2 * np.pi * (np.arange(count) + 0.5) / count + rng.normal(0, 0.03, count)
    height = np.where(np.arange(count) % 4 == 3, HIGH, LOW) + rng.normal(0, 0.03, count)
    ground = np.array([1.0, 0.0, 1.0])
    centre = target * ground + DISTANCE * np.stack([np.sin(turn), np.zeros(count), np.cos(turn)], 1) + height[:, None] * (1 - ground)
    R = np.stack([_look_at(c, target + rng.normal(0, 0.01, 3)) for c in centre])
    sizes = np.full((count, 2), size, np.int32)
    if portrait is not None:
        sizes[portrait, 0] = size * 3 // 4
    f = size * np.linalg.norm(centre - target, axis=1) / FIELD * (1 + rng.normal(0, 0.01, count))
    K = np.zeros((count, 3, 3))
    K[:, 0, 0] = K[:, 1, 1] = f
    K[:, :2, 2] = sizes / 2 + rng.normal(0, 0.004 * size, (count, 2))
    K[:, 2, 2] = 1
    names = tuple(f"Cam{k + 1:03d}" for k in range(count))
    return Cameras(names, K, R, -np.einsum("kij,kj->ki", R, centre), sizes, np.zeros((count, 5)))


def _look_at(centre: Array, target: Array) -> Array:
    """World to camera [3, 3]: rows right, down, forward, the horizon level."""
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward])
