"""Pictures of textured rectangles, by casting rays; shares nothing with what it tests but the camera's numbers."""

from dataclasses import dataclass

import numpy as np

from tasks.geometry.cameras import Cameras


@dataclass(frozen=True)
class Rectangle:
    """A picture [height, width] stretched over corner + a·u + b·v with a, b in [0, 1]: u along its columns, v ⊥ u down its rows."""

    corner: np.ndarray
    u: np.ndarray
    v: np.ndarray
    texture: np.ndarray


def rays(cameras: Cameras, k: int, *, samples: int = 3) -> np.ndarray:
    """World directions [sample, height × width, 3] of camera k's pixels, samples² of them per pixel."""
    (w, h), offsets = cameras.size[k], (np.arange(samples) + 0.5) / samples
    grids = [np.stack(np.meshgrid(np.arange(w) + du, np.arange(h) + dv), -1).reshape(-1, 2) for du in offsets for dv in offsets]
    return np.stack([np.c_[_unlensed(cameras, k, g), np.ones(w * h)] @ cameras.R[k] for g in grids])


def render(cameras: Cameras, k: int, rectangles: list[Rectangle], directions: np.ndarray, *, background: float = 128.0) -> np.ndarray:
    """What camera k sees [height, width, 3]: the nearest rectangle, mean over the rays of a pixel."""
    w, h = cameras.size[k]
    origin = cameras.centres()[k]
    shade = np.mean([_shade(origin, d, rectangles, background) for d in directions], axis=0).reshape(h, w)
    return np.repeat(np.rint(shade).astype(np.uint8)[..., None], 3, axis=2)


def texture(seed: int, size: int) -> np.ndarray:
    """Noise with detail at every scale."""
    import cv2

    rng, total = np.random.default_rng(seed), np.zeros((size, size))
    for octave in range(3, int(np.log2(size)) + 1):
        total += cv2.resize(rng.normal(size=(2**octave, 2**octave)), (size, size), interpolation=cv2.INTER_CUBIC)
    return np.clip(128 + 45 * total / total.std(), 0, 255)


def _shade(origin: np.ndarray, directions: np.ndarray, rectangles: list[Rectangle], background: float) -> np.ndarray:
    nearest, shade = np.full(len(directions), np.inf), np.full(len(directions), background)
    for r in rectangles:
        n = np.cross(r.u, r.v)
        s = (r.corner - origin) @ n / (directions @ n)
        p = origin + s[:, None] * directions - r.corner
        a, b = p @ r.u / (r.u @ r.u), p @ r.v / (r.v @ r.v)
        hit = (s > 1e-6) & (s < nearest) & (a >= 0) & (a < 1) & (b >= 0) & (b < 1)
        nearest[hit] = s[hit]
        rows, columns = r.texture.shape
        shade[hit] = r.texture[(b[hit] * rows).astype(int), (a[hit] * columns).astype(int)]
    return shade


def _unlensed(cameras: Cameras, k: int, uv: np.ndarray) -> np.ndarray:
    """Inverse of the lens by Newton's method on Brown's polynomial."""
    k1, k2, p1, p2, k3 = cameras.distortion[k]
    target = (uv - cameras.K[k, :2, 2]) / np.diag(cameras.K[k])[:2]
    q = target.copy()
    for _ in range(3 if cameras.distortion[k].any() else 0):
        x, y = q.T
        r2 = x * x + y * y
        radial, slope = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3, 2 * k1 + 4 * k2 * r2 + 6 * k3 * r2**2
        e = (
            np.stack([x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], -1)
            - target
        )
        xx, yy = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x, radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
        xy = slope * x * y + 2 * p1 * x + 2 * p2 * y
        q -= np.stack([yy * e[:, 0] - xy * e[:, 1], xx * e[:, 1] - xy * e[:, 0]], -1) / (xx * yy - xy * xy)[:, None]
    return q
