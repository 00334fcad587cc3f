"""Calibrated pinhole cameras with Brown distortion.

x_cam = R x + t, camera axes right, down, forward; K in pixels; pixel (i, j) covers [i, i+1) × [j, j+1), so the centre of the first
pixel is (0.5, 0.5). Distortion is OpenCV's k1 k2 p1 p2 k3.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cameras:
    """A rig. K [camera, 3, 3] px; R [camera, 3, 3] world to camera; t [camera, 3] m; size [camera, 2] (width, height) px; distortion [camera, 5]."""

    names: tuple[str, ...]
    K: Array
    R: Array
    t: Array
    size: NDArray[np.int32]
    distortion: Array

    def __len__(self) -> int:
        return len(self.names)

    def centres(self) -> Array:
        """Camera centres −Rᵀt [camera, 3] m."""
        return -np.einsum("kji,kj->ki", self.R, self.t)

    def subset(self, indices: Sequence[int] | NDArray[np.integer]) -> "Cameras":
        """The cameras at these places, in this order."""
        i = np.asarray(indices, int)
        return Cameras(tuple(self.names[k] for k in i), self.K[i], self.R[i], self.t[i], self.size[i], self.distortion[i])

    def scaled(self, factor: float) -> "Cameras":
        """The rig as seen in images resized by `factor`; sizes are rounded and K follows the rounded sizes."""
        size = np.maximum(1, np.rint(self.size * factor)).astype(np.int32)
        K = self.K.copy()
        K[:, :2] *= (size / self.size)[:, :, None]
        return replace(self, K=K, size=size)


def project(cameras: Cameras, x: Array) -> tuple[Array, Array]:
    """Pixels uv [camera, ..., 2] and depth [camera, ...] m of world points x [..., 3]. Points behind a camera have depth ≤ 0 and NaN pixels."""
    p = np.einsum("kij,...j->k...i", cameras.R, x) + _expand(cameras.t, np.ndim(x))
    depth = p[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        q = np.where(depth[..., None] > 0, p[..., :2] / depth[..., None], np.nan)
    q = _distort(q, _expand(cameras.distortion, np.ndim(x)))
    K = cameras.K.reshape(len(cameras), *([1] * (np.ndim(x) - 1)), 3, 3)
    return (K[..., :2, :2] @ q[..., None])[..., 0] + K[..., :2, 2], depth


def undistort_points(cameras: Cameras, uv: Array) -> Array:
    """Where a camera without distortion but the same K sees what these cameras see at uv [camera, ..., 2] px. Fixed point, to 1e-12."""
    K = cameras.K.reshape(len(cameras), *([1] * (uv.ndim - 2)), 3, 3)
    q0 = np.linalg.solve(K[..., :2, :2], (uv - K[..., :2, 2])[..., None])[..., 0]
    d = _expand(cameras.distortion, uv.ndim - 1)
    q = q0
    for _ in range(50):
        q = q + q0 - _distort(q, d)
    return (K[..., :2, :2] @ q[..., None])[..., 0] + K[..., :2, 2]


def triangulate(cameras: Cameras, uv: Array, weight: Array) -> tuple[Array, Array]:
    """Points x [point, 3] m from pixels uv [camera, point, 2] with weights [camera, point] ≥ 0, and reprojection errors [camera, point] px.

    Direct linear transform (Hartley & Zisserman 2004, §12.2) on undistorted pixels in units of the focal length, then two Gauss–Newton
    steps on the reprojection. Points with fewer than two weighted views are NaN.
    """
    w = np.where(np.isfinite(uv).all(-1), weight, 0.0)
    q = _normalised(cameras, np.where(np.isfinite(uv), uv, 0.0))
    P = np.concatenate([cameras.R, cameras.t[:, :, None]], 2)
    rows = w[:, :, None, None] * (q[..., None] * P[:, None, None, 2] - P[:, None, :2])  # [camera, point, 2, 4]
    A = rows.transpose(1, 0, 2, 3).reshape(uv.shape[1], -1, 4)
    X = np.linalg.svd(A)[2][:, -1]
    with np.errstate(divide="ignore", invalid="ignore"):
        x = X[:, :3] / X[:, 3:]
    x[(w > 0).sum(0) < 2] = np.nan
    for _ in range(2):
        x = x + _reprojection_step(cameras, x, q, w)
    return x, np.linalg.norm(project(cameras, x)[0] - uv, axis=-1)


def _reprojection_step(cameras: Cameras, x: Array, q: Array, w: Array) -> Array:
    p = np.einsum("kij,nj->kni", cameras.R, x) + cameras.t[:, None]
    z = p[..., 2:]
    J = (cameras.R[:, None, :2] - (p[..., :2] / z)[..., None] * cameras.R[:, None, 2:]) / z[..., None]  # [camera, point, 2, 3]
    r = q - p[..., :2] / z
    A = np.einsum("kn,knai,knaj->nij", w, J, J)
    b = np.einsum("kn,knai,kna->ni", w, J, r)
    ok = np.isfinite(A).all((1, 2)) & (np.linalg.cond(np.where(np.isfinite(A), A, 0.0)) < 1e12)
    step = np.zeros_like(x)
    step[ok] = np.linalg.solve(A[ok], b[ok, :, None])[..., 0]
    return step


def _normalised(cameras: Cameras, uv: Array) -> Array:
    u = undistort_points(cameras, uv) - cameras.K[:, None, :2, 2]
    return np.linalg.solve(cameras.K[:, None, :2, :2], u[..., None])[..., 0]


def _distort(q: Array, d: Array) -> Array:
    k1, k2, p1, p2, k3 = np.moveaxis(d, -1, 0)
    x, y = q[..., 0], q[..., 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.stack([x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], -1)


def _expand(a: Array, ndim: int) -> Array:
    return a.reshape(len(a), *([1] * (ndim - 1)), a.shape[-1])
