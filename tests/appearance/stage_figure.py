"""A small dressed figure for tests: a closed body with a flared, open, waving skirt around it, two charts, and a ring of cameras."""

import numpy as np
from scipy.ndimage import gaussian_filter

from tasks.appearance.scene import Scene
from tasks.geometry.cameras import Cameras


def lathe(height, radius, around: int, *, wave=0.0, phase=0.0):
    """A surface of revolution from top to bottom, seam only in UV: vertices, faces, uv_vertices in the unit square, uv_faces."""
    φ = 2 * np.pi * np.arange(around) / around
    drop = (height[0] - height) / (height[0] - height[-1])
    r = radius[:, None] * (1 + wave * drop[:, None] * np.sin(6 * φ + phase))
    vertices = np.stack([r * np.sin(φ), np.repeat(height[:, None], around, 1), r * np.cos(φ)], -1).reshape(-1, 3)
    u, v = np.meshgrid(np.arange(around + 1) / around, 1 - drop)
    return vertices, strip(around, len(height), closed=True), np.stack([u, v], -1).reshape(-1, 2), strip(around, len(height), closed=False)


def strip(around: int, along: int, *, closed: bool):
    width = around if closed else around + 1
    j, i = (a.ravel() for a in np.meshgrid(np.arange(along - 1), np.arange(around), indexing="ij"))
    a, b = j * width + i, j * width + ((i + 1) % around if closed else i + 1)
    return np.concatenate([np.stack([a, a + width, b + width], 1), np.stack([a, b + width, b], 1)]).astype(np.int32)


def dressed(phase=0.0, *, fineness=1):
    """(vertices, faces, uv_vertices, uv_faces): body and skirt in one mesh, the body's chart left, the skirt's right."""
    s = np.linspace(0, 1, 10 * fineness)
    body = lathe(1.7 - 1.7 * s, 0.15 * np.clip(1 - (2 * s - 1) ** 6, 1e-3, 1) ** 0.5, 16 * fineness)
    skirt = lathe(np.linspace(1.05, 0.5, 8 * fineness), np.linspace(0.18, 0.36, 8 * fineness), 24 * fineness, wave=0.2, phase=phase)
    return (
        np.concatenate([body[0], skirt[0]]),
        np.concatenate([body[1], skirt[1] + len(body[0])]),
        np.concatenate([body[2] * [0.44, 0.9] + [0.03, 0.05], skirt[2] * [0.44, 0.9] + [0.53, 0.05]]),
        np.concatenate([body[3], skirt[3] + len(body[2])]),
    )


def ring(count: int, size: int, *, distance=2.6) -> Cameras:
    """Cameras around the figure at breast height, every other one from above; the principal point is off the middle."""
    K = np.array([[1.2 * size, 0, 0.47 * size], [0, 1.2 * size, 0.52 * size], [0, 0, 1.0]])
    R, t = [], []
    for k in range(count):
        angle = 2 * np.pi * k / count + 0.2
        centre = np.array([distance * np.sin(angle), 1.1 + 0.9 * (k % 2), distance * np.cos(angle)])
        z = np.array([0, 0.85, 0]) - centre
        x = np.cross(z, [0, 1.0, 0])
        axes = [a / np.linalg.norm(a) for a in (x, np.cross(z, x), z)]
        R.append(axes)
        t.append(-np.array(axes) @ centre)
    names = tuple(f"Cam{k + 1:03d}" for k in range(count))
    return Cameras(names, np.tile(K, (count, 1, 1)), np.array(R), np.array(t), np.full((count, 2), size, np.int32), np.zeros((count, 5)))


def dressed_scene(*, frames=2, cameras=6, size=96, fineness=1) -> Scene:
    _, faces, uv_vertices, uv_faces = dressed(fineness=fineness)
    vertices = np.stack([dressed(0.6 * k, fineness=fineness)[0] for k in range(frames)])
    return Scene(vertices, faces, uv_vertices, uv_faces, ring(cameras, size))


def blotches(size: int, *, seed=0):
    """A smooth random texture [size, size, 3], linear, between 0.05 and 0.9."""
    noise = gaussian_filter(np.random.default_rng(seed).normal(size=(size, size, 3)), (size / 24, size / 24, 0))
    return np.clip(0.45 + 0.15 * noise / noise.std((0, 1)), 0.05, 0.9).astype(np.float32)
