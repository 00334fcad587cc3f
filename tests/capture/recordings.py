"""Small recordings in the ActorsHQ layout, written to a temporary folder."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from tasks.capture.calibration_actorshq import write_calibration_csv
from tasks.geometry.cameras import Cameras
from tasks.geometry.rotations import matrix_from_axis_angle

NAMES = ("Cam001", "Cam002", "Cam127")
FRAMES = (0, 1, 2)
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def ring(
    count: int = 3, *, radius: float = 2.6, size: tuple[int, int] = (64, 48), focal: float = 60.0, height: float = 1.0, above: float = 0.2
) -> Cameras:
    """Cameras on a circle, `above` its middle and all looking at it; the last stands upright (width and height swapped)."""
    φ = 2 * np.pi * np.arange(count) / count
    C = np.stack([radius * np.sin(φ), np.full(count, height + above), radius * np.cos(φ)], 1)
    forward = np.array([0, height, 0]) - C
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    right = np.cross(forward, [0, 1.0, 0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    R = np.stack([right, np.cross(forward, right), forward], 1)
    sizes = np.tile(size, (count, 1))
    sizes[-1] = size[::-1]
    K = np.tile(np.diag([focal, focal, 1.0]), (count, 1, 1))
    K[:, :2, 2] = sizes / 2
    names = NAMES if count == 3 else tuple(f"Cam{k + 1:03d}" for k in range(count))
    return Cameras(names, K, R, -np.einsum("kij,kj->ki", R, C), sizes.astype(np.int32), np.zeros((count, 5)))


def random_rig(seed: int, count: int = 5) -> Cameras:
    """Cameras turned any way, with any lens, within a ball of 3 m."""
    rng = np.random.default_rng(seed)
    R = matrix_from_axis_angle(rng.normal(size=(count, 3)))
    size = rng.integers(300, 900, (count, 2))
    K = np.tile(np.eye(3), (count, 1, 1))
    K[:, 0, 0], K[:, 1, 1] = rng.uniform(400, 900, (2, count))
    K[:, :2, 2] = size / 2 + rng.normal(size=(count, 2)) * 20
    t = -np.einsum("kij,kj->ki", R, rng.uniform(-3, 3, (count, 3)))
    return Cameras(tuple(f"Cam{k + 1:03d}" for k in range(count)), K, R, t, size.astype(np.int32), np.zeros((count, 5)))


def write_sequence(folder: Path, rig: Cameras | None = None, *, frames: Sequence[int] = FRAMES) -> Path:
    """Actor01/Sequence1 with scale 4x, three cameras, three frames, masks, boxes, lamps, a template."""
    rig = rig or ring()
    sequence, scale = folder / "Actor01" / "Sequence1", folder / "Actor01" / "Sequence1" / "4x"
    scale.mkdir(parents=True)
    write_calibration_csv(scale / "calibration.csv", rig)
    (scale / "light_annotations.csv").write_text("camera,x,y,r\nCam001,3.5,4,2\n")
    (sequence / "scene.json").write_text(json.dumps({"num_frames": len(frames)}))
    (sequence / "physavatar.json").write_text(json.dumps({"fps": 25, "up": "y", "mass_kg": 0.3, "first_frame": 0}))
    box = "frame_number,aabb_min_x,aabb_min_y,aabb_min_z,aabb_max_x,aabb_max_y,aabb_max_z\n"
    (sequence / "aabbs.csv").write_text(box + "".join(f"{f},-0.5,0,-0.5,0.5,1.7,0.5\n" for f in frames))
    (sequence / "template").mkdir()
    (sequence / "template" / "template.obj").write_text(TRIANGLE)
    rng = np.random.default_rng(0)
    for k, name in enumerate(rig.names):
        w, h = rig.size[k]
        for kind in ("rgb", "mask"):
            (scale / f"{kind}s" / name).mkdir(parents=True)
        for frame in frames:
            Image.fromarray(rng.integers(0, 255, (h, w, 3), np.uint8)).save(picture(sequence, name, frame), quality=90)
            Image.fromarray(mask_of(w, h)).save(mask(sequence, name, frame))
    return sequence


def picture(sequence: Path, name: str, frame: int) -> Path:
    return sequence / "4x" / "rgbs" / name / f"{name}_rgb{frame:06d}.jpg"


def mask(sequence: Path, name: str, frame: int) -> Path:
    return sequence / "4x" / "masks" / name / f"{name}_mask{frame:06d}.png"


def mask_of(width: int, height: int) -> np.ndarray:
    m = np.zeros((height, width), np.uint8)
    m[height // 4 : 3 * height // 4, width // 3 : 2 * width // 3] = 255
    return m
