"""Colour of every pixel of a training picture: solid textures under a sun, a sky and a lamp at the camera, in a room.

    L = c(p) · [ sky·(½ + ½ n_y) + ground·(½ − ½ n_y) + s·sun·max(n·l, 0) + lamp·max(n·view, 0) ] + gloss·s·sun·(n·h)³²

s is 0 in shadow (a depth map seen from the sun, Williams 1978). Pixels that see no surface see the inside of a box, the room, textured
and shadowed likewise. Limits: one bounce, hard shadows, no lens; meant to be varied and fast, not right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

from tasks.geometry.rasterise import rasterise
from tasks.keypoints.materials import Material
from tasks.keypoints.wardrobe import Piece

SUN_DISTANCE = 30.0  # [m]
SHADOW_SIZE = 224  # [px]
SHADOW_RADIUS = 2.2  # [m] what the shadow map covers around the person
BIAS = 0.03  # [m]


@dataclass(frozen=True)
class Light:
    """Unit direction to the sun [3]; linear RGB [3] of sun, sky, ground and of the lamp at the camera; hard shadows or none."""

    towards_sun: np.ndarray
    sun: np.ndarray
    sky: np.ndarray
    ground: np.ndarray
    lamp: np.ndarray
    shadows: bool


@dataclass(frozen=True)
class Room:
    """The inside of a box: corners low, high [3] m and six materials (−x, +x, floor, ceiling, −z, +z)."""

    low: np.ndarray
    high: np.ndarray
    materials: tuple[Material, ...]


def render(pieces: list[Piece], K: np.ndarray, R: np.ndarray, t: np.ndarray, size: tuple[int, int], light: Light, room: Room):
    """(linear RGB [height,width,3] float32, depth [height,width] m inf in the room, piece [height,width] int, −1 = room)."""
    start = np.cumsum([0, *(len(p.vertices) for p in pieces)])
    vertices = np.concatenate([p.vertices for p in pieces])
    faces = np.concatenate([p.faces + s for p, s in zip(pieces, start)]).astype(np.int32)
    owner = np.repeat(np.arange(len(pieces)), [len(p.faces) for p in pieces])
    attributes = np.concatenate([np.hstack([p.normals, p.texture, p.tint]) for p in pieces]).astype(np.float32)
    seen = rasterise(K, R, t, size, vertices, faces)
    if light.shadows:
        Ks, Rs, ts = _sun_camera(light.towards_sun, vertices[: len(pieces[0].vertices)].mean(0))
        shadow = rasterise(Ks, Rs, ts, (SHADOW_SIZE, SHADOW_SIZE), vertices, faces).depth
    else:
        Ks, Rs, ts, shadow = np.eye(3), np.eye(3), np.zeros(3), np.full((1, 1), np.inf, np.float32)
    materials = np.stack([m.row() for m in (*(p.material for p in pieces), *room.materials)])
    image = np.zeros((*seen.depth.shape, 3), np.float32)
    lights = np.stack([light.towards_sun, light.sun, light.sky, light.ground, light.lamp]).astype(np.float32)
    bounds = np.stack([room.low, room.high])
    _shade(seen.face, seen.barycentric, seen.depth, faces, owner, attributes, materials, K, R, t, lights, bounds, Ks, Rs, ts, shadow, image)
    return image, seen.depth, np.where(seen.face >= 0, owner[seen.face], -1)


def look_at(eye: np.ndarray, target: np.ndarray, roll: float) -> tuple[np.ndarray, np.ndarray]:
    """World-to-camera R [3,3], t [3] of a camera at `eye` that looks at `target`, turned by `roll` rad about its axis."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    c, s = np.cos(roll), np.sin(roll)
    R = np.stack([c * right + s * down, -s * right + c * down, forward])
    return R, -R @ eye


def _sun_camera(towards_sun: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    R, t = look_at(target + SUN_DISTANCE * towards_sun, target, 0.0)
    f = SHADOW_SIZE / 2 * SUN_DISTANCE / SHADOW_RADIUS
    return np.array([[f, 0, SHADOW_SIZE / 2], [0, f, SHADOW_SIZE / 2], [0, 0, 1.0]]), R, t


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _shade(face, barycentric, depth, faces, owner, attributes, materials, K, R, t, lights, bounds, Ks, Rs, ts, shadow, image):
    height, width = depth.shape
    pieces = len(materials) - 6
    eye = -(R.T @ t)
    p, n, x, tint, ray, colour = np.zeros(3), np.zeros(3), np.zeros(3), np.ones(3), np.zeros(3), np.zeros(3)
    for j in range(height):
        for i in range(width):
            u, v = (i + 0.5 - K[0, 2]) / K[0, 0], (j + 0.5 - K[1, 2]) / K[1, 1]
            for a in range(3):
                ray[a] = R[0, a] * u + R[1, a] * v + R[2, a]
            f = face[j, i]
            if f >= 0:
                for a in range(3):
                    n[a], x[a], tint[a] = 0.0, 0.0, 0.0
                    for corner in range(3):
                        b, vertex = barycentric[j, i, corner], faces[f, corner]
                        n[a] += b * attributes[vertex, a]
                        x[a] += b * attributes[vertex, 3 + a]
                        tint[a] += b * attributes[vertex, 6 + a]
                    p[a] = eye[a] + depth[j, i] * ray[a]
                m = materials[owner[f]]
                if n[0] * ray[0] + n[1] * ray[1] + n[2] * ray[2] > 0:  # the inside of a shell
                    for a in range(3):
                        n[a] = -n[a]
            else:
                m = materials[pieces + _wall(eye, ray, bounds, p, n)]
                for a in range(3):
                    x[a], tint[a] = p[a], 1.0
            _texture(x, m, colour)
            lit = 0.0 if _in_shadow(p, Ks, Rs, ts, shadow) else 1.0
            size, span = math.sqrt(n[0] ** 2 + n[1] ** 2 + n[2] ** 2) + 1e-9, math.sqrt(ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2)
            up, lambert, facing, half, norm = n[1] / size, 0.0, 0.0, 0.0, 0.0
            for a in range(3):
                lambert += n[a] / size * lights[0, a]
                facing -= n[a] / size * ray[a] / span
                h = lights[0, a] - ray[a] / span
                half += h * n[a] / size
                norm += h * h
            lambert, facing = max(lambert, 0.0), max(facing, 0.0)
            shine = m[12] * lit * (max(half, 0.0) / math.sqrt(norm + 1e-9)) ** 32 if m[12] > 0 and lambert > 0 else 0.0
            for a in range(3):
                light = (
                    lights[2, a] * (0.5 + 0.5 * up) + lights[3, a] * (0.5 - 0.5 * up) + lit * lights[1, a] * lambert + lights[4, a] * facing
                )
                image[j, i, a] = tint[a] * colour[a] * light + shine * lights[1, a]


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _wall(eye, ray, bounds, p, n):
    """Which wall the ray leaves the room by; sets the point p and the inward normal n."""
    nearest, wall = 1e9, 0
    for a in range(3):
        if ray[a] != 0.0:
            side = 1 if ray[a] > 0 else 0
            s = (bounds[side, a] - eye[a]) / ray[a]
            if s < nearest:
                nearest, wall = s, 2 * a + side
    for a in range(3):
        p[a], n[a] = eye[a] + nearest * ray[a], 0.0
    n[wall // 2] = -1.0 if wall % 2 == 1 else 1.0
    return wall


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _in_shadow(p, Ks, Rs, ts, shadow):
    size = shadow.shape[0]
    if size == 1:
        return False
    q0 = Rs[0, 0] * p[0] + Rs[0, 1] * p[1] + Rs[0, 2] * p[2] + ts[0]
    q1 = Rs[1, 0] * p[0] + Rs[1, 1] * p[1] + Rs[1, 2] * p[2] + ts[1]
    q2 = Rs[2, 0] * p[0] + Rs[2, 1] * p[1] + Rs[2, 2] * p[2] + ts[2]
    if q2 <= 0:
        return False
    i, j = math.floor(Ks[0, 0] * q0 / q2 + Ks[0, 2]), math.floor(Ks[1, 1] * q1 / q2 + Ks[1, 2])
    return 0 <= i < size and 0 <= j < size and shadow[j, i] < q2 - BIAS


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _texture(x, m, colour):
    """Colour of material row m at the point x, into `colour`."""
    k0, k1, k2 = m[7] * x[0], m[8] * x[1], m[9] * x[2]
    pattern, blend = int(m[6]), 0.0
    if pattern == 1:
        blend = 1.0 if math.sin(k0 + k1 + k2) > 0 else 0.0
    elif pattern == 2:
        blend = 0.5 * ((1.0 if math.sin(k0 + k1 + k2) > 0 else 0.0) + (1.0 if math.sin(k0 - k1 + k2) > 0 else 0.0))
    elif pattern == 3:
        scale = (abs(m[7]) + abs(m[8]) + abs(m[9])) / 6.28
        blend = min(max(3.0 * _noise(x[0] * scale, x[1] * scale, x[2] * scale) - 1.0, 0.0), 1.0)
    elif pattern == 4:
        scale = (abs(m[7]) + abs(m[8]) + abs(m[9])) / 2
        blend = 1.0 if math.sin(scale * x[0]) * math.sin(scale * x[1]) > 0.4 else 0.0
    grain = 1.0
    if m[10] > 0:
        grain += m[10] * (2 * _noise(x[0] / m[11], x[1] / m[11], x[2] / m[11]) - 1)
    for a in range(3):
        colour[a] = (m[a] + (m[3 + a] - m[a]) * blend) * grain


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _noise(x, y, z):
    """Value noise in [0,1] on the unit lattice, smooth between."""
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    a, b, c = x - i, y - j, z - k
    a, b, c = a * a * (3 - 2 * a), b * b * (3 - 2 * b), c * c * (3 - 2 * c)
    total = 0.0
    for da in range(2):
        for db in range(2):
            for dc in range(2):
                weight = (a if da else 1 - a) * (b if db else 1 - b) * (c if dc else 1 - c)
                total += weight * _lattice(i + da, j + db, k + dc)
    return total


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _lattice(i, j, k):
    h = (i * 374761393 + j * 668265263 + k * 2147483647) & 0xFFFFFFFF
    h = ((h ^ (h >> 13)) * 1274126177) & 0xFFFFFFFF
    return ((h ^ (h >> 16)) & 0xFFFF) / 65535.0
