"""Rotations as axis-angle vectors and matrices, batched over leading axes."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def skew(a: Array) -> Array:
    """[a]ₓ with [a]ₓ b = a × b; a [..., 3] -> [..., 3, 3]."""
    a = np.asarray(a, float)
    K = np.zeros((*a.shape[:-1], 3, 3))
    K[..., 0, 1], K[..., 0, 2], K[..., 1, 2] = -a[..., 2], a[..., 1], -a[..., 0]
    return K - np.swapaxes(K, -1, -2)


def matrix_from_axis_angle(r: Array) -> Array:
    """Rodrigues: R = I + sin θ/θ [r]ₓ + (1 − cos θ)/θ² [r]ₓ²; r [..., 3] rad -> [..., 3, 3]."""
    r = np.asarray(r, float)
    θ = np.linalg.norm(r, axis=-1)[..., None, None]
    K = skew(r)
    # np.sinc(x) = sin(πx)/(πx) is smooth at 0, where sin θ/θ is not computable
    a, b = np.sinc(θ / np.pi), np.sinc(θ / (2 * np.pi)) ** 2 / 2
    return np.eye(3) + a * K + b * (K @ K)


def axis_angle_from_matrix(R: Array) -> Array:
    """Inverse of `matrix_from_axis_angle`, |r| ≤ π; R [..., 3, 3] -> [..., 3] rad."""
    from scipy.spatial.transform import Rotation

    R = np.asarray(R, float)
    return Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec().reshape(R.shape[:-1])


def rotation_between(a: Array, b: Array) -> Array:
    """The smallest rotation that turns direction a into direction b; [..., 3], [..., 3] -> [..., 3, 3]."""
    a = a / np.linalg.norm(a, axis=-1, keepdims=True)
    b = b / np.linalg.norm(b, axis=-1, keepdims=True)
    n = np.cross(a, b)
    sin, cos = np.linalg.norm(n, axis=-1, keepdims=True), np.sum(a * b, -1, keepdims=True)
    across = np.cross(a, np.where(np.abs(a[..., :1]) < 0.9, [1.0, 0, 0], [0, 1.0, 0]))  # any normal serves for opposite directions
    axis = np.where(sin > 1e-12, n, across)
    axis = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    return matrix_from_axis_angle(axis * np.arctan2(sin, cos))
