"""A skirt that swings, and calibrated images of it: position-based dynamics for the motion, the project's rasteriser for the pictures.

A cone welded at the seam with nine folds, its waist ring moved and turned, two capsule legs swinging inside (Müller et al. 2007).
Images are supersampled, textured with noise of several scales and lit by a sky, so that shading changes with the folds. Nothing here is
shared with the tracker but the camera model and the rasteriser.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numba import njit

from tasks.geometry.cameras import Cameras
from tasks.geometry.meshes import edges, hinges, vertex_normals
from tasks.geometry.rasterise import rasterise

FPS = 25
_SUBSTEPS = 40  # many small steps converge better than few with many sweeps
_LEG = 0.095  # [m] radius


@dataclass(frozen=True)
class Skirt:
    """vertices [T, V, 3] m true; faces [F, 3]; uv [V, 2] with seam at `uv_faces`' own indices; cameras;
    images uint8, masks bool [T][camera].
    """

    vertices: np.ndarray
    faces: np.ndarray
    cameras: Cameras
    images: list
    masks: list

    def image(self, frame, camera):
        return self.images[frame][camera]

    def mask(self, frame, camera):
        return self.masks[frame][camera]


@cache
def skirt(columns=80, rows=61, frames=10, size=512, views=8, texture="rich", noise=0.0) -> Skirt:
    """The set of a given resolution; views of unequal size, focal length and principal point."""
    vertices, faces = motion(columns, rows, frames)
    uv = corner_uv(columns, rows)
    cameras = ring(views, size)
    picture = TEXTURES[texture]()
    rng = np.random.default_rng(5)
    images, masks = [], []
    for x in vertices:
        shots = [photograph(cameras, k, x, faces, uv, picture) for k in range(len(cameras))]
        images.append([np.clip(rgb + noise * 255 * rng.standard_normal(rgb.shape), 0, 255).round().astype(np.uint8) for rgb, _ in shots])
        masks.append([alpha for _, alpha in shots])
    return Skirt(vertices, faces, cameras, images, masks)


def ring(views, size, *, radius=2.2, height=0.55) -> Cameras:
    """Cameras looking at the axis; every other one is portrait with a longer lens and an off-centre principal point."""
    K, R, t, sizes = [], [], [], []
    for k in range(views):
        φ = 2 * np.pi * k / views + 0.2
        centre = np.array([radius * np.sin(φ), height + 0.25 * (-1) ** k, radius * np.cos(φ)])
        forward = np.array([0, 0.5, 0]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 1, 0])
        right /= np.linalg.norm(right)
        R.append(np.array([right, np.cross(forward, right), forward]))
        t.append(-R[-1] @ centre)
        f = 1.586 * size
        w, h = (size, size) if k % 2 else (size - size // 8, size + size // 16)
        K.append(np.array([[f, 0, w / 2 + (k % 3) * size / 100], [0, f * 1.002, h / 2 - (k % 2) * size / 128], [0, 0, 1]]))
        sizes.append((w, h))
    return Cameras(
        tuple(f"Cam{k:03d}" for k in range(1, views + 1)),
        np.array(K),
        np.array(R),
        np.array(t),
        np.array(sizes, np.int32),
        np.zeros((views, 5)),
    )


def cone(columns, rows):
    """Vertices [V, 3], faces and the texture coordinates of face corners."""
    s, φ = np.meshgrid(np.linspace(0, 1, rows), 2 * np.pi * np.arange(columns) / columns, indexing="ij")
    radius = (0.13 + 0.3 * s) * (1 + 0.12 * s * np.sin(9 * φ))
    vertices = np.stack([radius * np.cos(φ), 1.08 - 1.0 * s, radius * np.sin(φ)], -1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns), indexing="ij")
    a, b = i * columns + j, i * columns + (j + 1) % columns
    c, d = a + columns, b + columns
    odd = ((i + j) % 2 == 1)[..., None]
    faces = np.where(odd[..., None], _pair(a, b, c, b, d, c), _pair(a, b, d, a, d, c)).reshape(-1, 3)
    return vertices, faces.astype(np.int32)


def corner_uv(columns, rows):
    """Texture coordinates [F, 3, 2], continuous in every face across the seam."""
    _, faces = cone(columns, rows)
    column, row = faces % columns, faces // columns
    wrapped = (column.max(1) - column.min(1) > columns // 2)[:, None] & (column < columns // 2)
    return np.stack([(column + columns * wrapped) / columns, row / (rows - 1)], -1)


def _pair(*corners):
    return np.stack([np.stack(corners[:3], -1), np.stack(corners[3:], -1)], -2)


def motion(columns, rows, frames):
    """Vertices [frames, V, 3] after 1.2 s of settling and swinging."""
    x, faces = cone(columns, rows)
    E, H = edges(faces), hinges(faces)
    step = max(1, rows // 15)
    grid = np.arange(columns * rows).reshape(rows, columns)
    long = np.concatenate([_pairs(grid[:-step], grid[step:]), _pairs(grid, np.roll(grid, -step, 1))])
    pairs = np.concatenate([E, H[:, 2:], long])
    stiffness = np.concatenate([np.full(len(E), 1.0), np.full(len(H), 0.9), np.full(len(long), 0.02)])
    order = np.argsort(pairs.max(1) // columns + np.random.default_rng(1).uniform(0, 2, len(pairs)))  # downwards: sag settles in one sweep
    pairs, stiffness = pairs[order].astype(np.int64), stiffness[order]
    rest = np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1)
    v, waist, out = np.zeros_like(x), x[:columns].copy(), []
    for n in range(30 + frames):
        for k in range(_SUBSTEPS):
            time = (n + (k + 1) / _SUBSTEPS) / FPS
            _substep(x, v, pairs, stiffness, rest, _waist(waist, time), *_legs(time), 1 / FPS / _SUBSTEPS)
        if n >= 30:
            out.append(x.copy())
    return np.array(out), faces


def _pairs(a, b):
    return np.column_stack([a.ravel(), b.ravel()])


def _waist(ring, time):
    turn = 0.2 * np.sin(2 * np.pi * time / 1.1)
    c, s = np.cos(turn), np.sin(turn)
    shift = np.array(
        [0.025 * np.sin(2 * np.pi * time / 0.9), 0.008 * np.sin(4 * np.pi * time), 0.02 * np.cos(2 * np.pi * time / 1.3) - 0.02]
    )
    return ring @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) + shift


def _legs(time):
    swing = 0.2 * np.sin(2 * np.pi * time / 0.9)
    hip = np.array([[-0.08, 1.0, 0.0], [0.08, 1.0, 0.0]])
    foot = hip + 1.0 * np.array([[0, -np.cos(swing), np.sin(swing)], [0, -np.cos(swing), -np.sin(swing)]])
    return hip, foot


@njit(cache=True)
def _substep(x, v, pairs, stiffness, rest, waist, hip, foot, h):
    old = x.copy()
    v *= 0.9985
    v[:, 1] -= 9.81 * h
    x += h * v
    n = len(waist)
    for _ in range(5):
        x[:n] = waist
        for e in range(len(pairs)):
            i, j = pairs[e]
            wi, wj = (0.0 if i < n else 1.0), (0.0 if j < n else 1.0)
            if wi + wj == 0.0:
                continue
            d0, d1, d2 = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
            l = np.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
            s = stiffness[e] * (l - rest[e]) / (l * (wi + wj))
            x[i, 0] += wi * s * d0
            x[i, 1] += wi * s * d1
            x[i, 2] += wi * s * d2
            x[j, 0] -= wj * s * d0
            x[j, 1] -= wj * s * d1
            x[j, 2] -= wj * s * d2
        for i in range(n, len(x)):
            for leg in range(2):
                a, b = hip[leg], foot[leg]
                along, length2 = 0.0, 0.0
                for c in range(3):
                    along += (x[i, c] - a[c]) * (b[c] - a[c])
                    length2 += (b[c] - a[c]) ** 2
                s = min(max(along / length2, 0.0), 1.0)
                l = 0.0
                for c in range(3):
                    l += (x[i, c] - a[c] - s * (b[c] - a[c])) ** 2
                l = max(np.sqrt(l), 1e-9)
                if l < _LEG:
                    for c in range(3):
                        x[i, c] += (x[i, c] - a[c] - s * (b[c] - a[c])) * (_LEG / l - 1)
    v[:] = (x - old) / h


def _rich():
    """Noise of several scales and a print of dots [1024, 1024, 3] in [0, 1]."""
    import cv2

    rng = np.random.default_rng(2)
    out = np.full((1024, 1024, 3), 0.45)
    for cells, strength in ((16, 0.25), (48, 0.25), (128, 0.2), (400, 0.15)):
        grid = rng.uniform(-1, 1, (cells, cells, 3)).astype(np.float32)
        grid[:, -1] = grid[:, 0]  # the seam meets itself
        out += strength * cv2.resize(grid, (1024, 1024), interpolation=cv2.INTER_CUBIC)
    for u, v in rng.integers(30, 994, (60, 2)):
        cv2.circle(out, (int(u), int(v)), 14, rng.uniform(0, 1, 3).tolist(), -1)
    return np.clip(out, 0.02, 0.98).astype(np.float32)


def _plain():
    """Cloth of one colour with a fine weave."""
    weave = np.random.default_rng(3).uniform(-0.02, 0.02, (1024, 1024, 1))
    return (np.array([0.5, 0.35, 0.3]) + weave).astype(np.float32)


def _print():
    """The plain cloth with three hundred dots of a few colours, each some 3 cm wide and 6 cm apart."""
    import cv2

    rng = np.random.default_rng(4)
    out, colours = _plain(), np.array([[0.9, 0.9, 0.85], [0.75, 0.2, 0.2], [0.85, 0.7, 0.2]])
    for n, (i, j) in enumerate(np.ndindex(16, 20)):
        place = (np.array([(j + 0.5) / 20, (i + 0.5) / 16]) * 1024 + rng.uniform(-12, 12, 2)).astype(int)
        cv2.ellipse(out, tuple(int(a) for a in place), (12, 16), 0, 0, 360, colours[n % 3].tolist(), -1)
    return out


TEXTURES = {"rich": _rich, "plain": _plain, "print": _print}


def photograph(cameras, k, x, faces, uv, picture, *, samples=3):
    """(rgb [height, width, 3] 0..255, coverage [height, width] > ½): samples² rays per pixel, sky light from above on both sides."""
    width, height = cameras.size[k]
    K = cameras.K[k].copy()
    K[:2] *= samples
    seen = rasterise(K, cameras.R[k], cameras.t[k], (width * samples, height * samples), x, faces)
    normals = vertex_normals(x, faces)
    centre = cameras.centres()[k]
    rgb = _shade(seen.face, seen.barycentric, faces, uv, picture, normals, x, centre)
    rgb = rgb.reshape(height, samples, width, samples, 3).mean((1, 3))
    alpha = (seen.face >= 0).reshape(height, samples, width, samples).mean((1, 3)) > 0.5
    return rgb * 255, alpha


@njit(cache=True)
def _shade(face, barycentric, faces, uv, picture, normals, x, centre):
    height, width = face.shape
    out = np.zeros((height, width, 3), np.float32)
    for j in range(height):
        for i in range(width):
            f = face[j, i]
            if f < 0:
                continue
            u, v, n, towards = 0.0, 0.0, np.zeros(3), np.zeros(3)
            for c in range(3):
                b = barycentric[j, i, c]
                u += b * uv[f, c, 0]
                v += b * uv[f, c, 1]
                n += b * normals[faces[f, c]]
                towards += b * (centre - x[faces[f, c]])
            n /= np.sqrt(n @ n)
            if n @ towards < 0:
                n = -n
            light = 0.62 + 0.2 * n[1] + 0.18 * (0.6 * n[0] + 0.8 * n[2])
            s, t = (u % 1.0) * 1024 - 0.5, min(max(v, 0.0), 0.9999) * 1024 - 0.5
            a, b = int(np.floor(s)), int(np.floor(t))
            fs, ft = s - a, t - b
            for c in range(3):
                p00, p10 = picture[b % 1024, a % 1024, c], picture[b % 1024, (a + 1) % 1024, c]
                p01, p11 = picture[min(b + 1, 1023), a % 1024, c], picture[min(b + 1, 1023), (a + 1) % 1024, c]
                out[j, i, c] = light * ((1 - ft) * ((1 - fs) * p00 + fs * p10) + ft * ((1 - fs) * p01 + fs * p11))
    return out
