"""What stands around the person in a training picture: light, room, furniture, stick figures, or a painted backdrop.

Limits: boxes and rods only; the painted backdrops are polygons, lines and noise, no photographs.
"""

from __future__ import annotations

import cv2
import numpy as np

from tasks.geometry.meshes import face_normals
from tasks.geometry.rotations import matrix_from_axis_angle, rotation_between
from tasks.keypoints.materials import Material, cloth, wall
from tasks.keypoints.shading import Light, Room
from tasks.keypoints.wardrobe import Piece

CUBE = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
CUBE_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)
BONES = (
    (5, 6),
    (5, 7),
    (7, 9),
    (6, 8),
    (8, 10),
    (5, 11),
    (6, 12),
    (11, 12),
    (11, 13),
    (13, 15),
    (12, 14),
    (14, 16),
    (0, 5),
    (0, 6),
    (1, 2),
)
IVORY = Material((0.75, 0.68, 0.5), (0.6, 0.5, 0.35), grain=0.3, grain_size=0.03)


def random_light(random: np.random.Generator) -> Light:
    """From flat studio light to one hard lamp."""
    towards = random.normal(0, 1, 3)
    towards[1] = abs(towards[1]) + 0.2
    tone = lambda level: level * (1 + random.normal(0, 0.12, 3))  # noqa: E731
    return Light(
        towards_sun=towards / np.linalg.norm(towards),
        sun=tone(random.uniform(0, 1.3)),
        sky=tone(random.uniform(0.2, 0.9)),
        ground=tone(random.uniform(0.05, 0.5)),
        lamp=tone(random.choice([0.0, random.uniform(0, 0.4)])),
        shadows=bool(random.random() < 0.6),
    )


def random_room(eye: np.ndarray, random: np.random.Generator) -> Room:
    """A box around the origin, the person's place, and around the camera at `eye` [3] m; the floor is y = 0."""
    reach = random.uniform(1.0, 6.0, (2, 3))
    low, high = np.minimum(-reach[0], eye - 0.3), np.maximum(reach[1], eye + 0.3)
    low[1], high[1] = 0.0, max(random.uniform(2.3, 4.5), eye[1] + 0.2)
    return Room(low, high, tuple(wall(random) for _ in range(6)))


def furniture(eye: np.ndarray, random: np.random.Generator, *, occluder_chance: float = 0.12) -> list[Piece]:
    """A few boxes and rods around the person at the origin; one that stands between person and camera is kept by chance only."""
    pieces = []
    for _ in range(random.poisson(3.0)):
        rod = random.random() < 0.35
        size = np.array([0.04, random.uniform(0.5, 2.5), 0.04]) if rod else np.exp(random.uniform(np.log(0.12), np.log(1.6), 3))
        angle, distance = random.uniform(0, 2 * np.pi), random.uniform(0.5, 4.0)
        place = np.array(
            [distance * np.cos(angle), size[1] / 2 if random.random() < 0.6 else random.uniform(0, 2.5), distance * np.sin(angle)]
        )
        if place @ (eye * [1, 0, 1]) > 0.3 * distance * np.linalg.norm(eye[[0, 2]]) and random.random() > occluder_chance:
            continue
        tilt = matrix_from_axis_angle(np.array([random.normal(0, 0.15), random.uniform(0, np.pi), random.normal(0, 0.15)]))
        pieces.append(_box(size, tilt, place, cloth(random)))
    return pieces


def stick_figure(keypoints: np.ndarray) -> list[Piece]:
    """A skeleton-like figure of ivory rods along the limbs of body keypoints [≥17,3] m: it must not be taken for the person."""
    pieces = []
    for a, b in BONES:
        along = keypoints[b] - keypoints[a]
        length = np.linalg.norm(along)
        turn = rotation_between(np.array([0.0, 1.0, 0.0]), along / max(length, 1e-6))
        pieces.append(_box(np.array([0.035, length, 0.035]), turn, (keypoints[a] + keypoints[b]) / 2, IVORY))
    return pieces


def painted_backdrop(size: tuple[int, int], random: np.random.Generator) -> np.ndarray:
    """Linear RGB [height,width,3] in [0,1]: black, plain, or a gradient with polygons, lines and noise."""
    width, height = size
    kind = random.random()
    if kind < 0.3:
        return np.full((height, width, 3), random.choice([0.0, 0.003]), np.float32)
    if kind < 0.45:
        return np.broadcast_to(random.uniform(0, 1, 3) ** 2.2, (height, width, 3)).astype(np.float32).copy()
    corners = random.uniform(0, 1, (2, 2, 3)).astype(np.float32) ** 2.2
    picture = cv2.resize(corners, (width, height), interpolation=cv2.INTER_LINEAR)
    for _ in range(random.poisson(12)):
        colour = tuple(float(c) for c in random.uniform(0, 1, 3) ** 2.2)
        centre = random.uniform(0, 1, 2) * (width, height)
        corner = centre + random.normal(0, np.exp(random.uniform(2, 4.6)), (random.integers(3, 7), 2))
        if random.random() < 0.5:
            cv2.fillPoly(picture, [corner.astype(np.int32)], colour)
        else:
            cv2.polylines(picture, [corner.astype(np.int32)], bool(random.random() < 0.5), colour, int(random.integers(1, 14)))
    cells = int(random.integers(4, 90))
    noise = cv2.resize(random.normal(0, 1, (cells, cells, 3)).astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
    return np.clip(picture * (1 + random.uniform(0, 0.5) * noise), 0, 1)


def _box(size: np.ndarray, turn: np.ndarray, place: np.ndarray, material: Material) -> Piece:
    local = CUBE * size
    vertices = (local @ turn.T + place)[CUBE_FACES].reshape(-1, 3)  # corners doubled, so that normals are flat
    faces = np.arange(36, dtype=np.int32).reshape(12, 3)
    normals = np.repeat(face_normals(vertices, faces), 3, axis=0)
    return Piece(vertices, faces, normals, local[CUBE_FACES].reshape(-1, 3), np.ones_like(vertices), material)
