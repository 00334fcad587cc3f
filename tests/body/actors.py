"""Actors whose motion is known, and what a detector would see of them: noise on every point, and some points anywhere in the image."""

from dataclasses import dataclass

import numpy as np

from tasks.body.model import BodyModel, Posed
from tasks.body.skeleton import JOINT
from tasks.body.wholebody import keypoints133
from tasks.geometry.cameras import Cameras, project

SIZE, FOCAL, RADIUS, FPS = 512, 590.0, 2.6, 25


@dataclass(frozen=True)
class Actor:
    shape: np.ndarray
    pose: np.ndarray
    translation: np.ndarray
    posed: Posed


def ring(count: int) -> Cameras:
    """Cameras all round, two of eight higher up, looking at the origin."""
    R, t = [], []
    for k in range(count):
        turn = 2 * np.pi * k / count
        centre = np.array([RADIUS * np.sin(turn), 1.2 if k % 4 == 0 else 0.3, RADIUS * np.cos(turn)])
        forward = -centre / np.linalg.norm(centre)
        right = np.cross(forward, [0, 1, 0]) / np.linalg.norm(np.cross(forward, [0, 1, 0]))
        R.append(np.stack([right, np.cross(forward, right), forward]))
        t.append(-R[-1] @ centre)
    K = np.array([[FOCAL, 0, SIZE / 2], [0, FOCAL, SIZE / 2], [0, 0, 1]])
    names = tuple(f"Cam{k + 1:03d}" for k in range(count))
    return Cameras(names, np.tile(K, (count, 1, 1)), np.array(R), np.array(t), np.full((count, 2), SIZE), np.zeros((count, 5)))


def actor(model: BodyModel, frames: int, *, seed: int, turn: float = 1.0) -> Actor:
    """A random adult who swings all joints, arms down, elbows and knees bent, and turns at `turn` rad/s."""
    rng = np.random.default_rng(seed)
    s = np.arange(frames)[:, None, None] / FPS
    swing = rng.normal(0, 0.15, (55, 3)) * (np.arange(55) < 22)[:, None] + rng.normal(0, 0.08, (55, 3)) * (np.arange(55) >= 25)[:, None]
    pose = swing * np.sin(2 * np.pi * 0.7 * s + rng.uniform(0, 6, (55, 3)))
    for side, sign in (("left", 1), ("right", -1)):
        pose[:, JOINT[f"{side}_shoulder"], 2] -= 0.9 * sign
        pose[:, JOINT[f"{side}_elbow"], 1] -= sign * (0.5 + 0.3 * np.sin(4 * s[:, 0, 0]))
        pose[:, JOINT[f"{side}_knee"], 0] += 0.3 + 0.3 * sign * np.sin(5 * s[:, 0, 0])
        first = JOINT[f"{side}_index1"]
        pose[:, first : first + 15, 2] -= 0.3 * sign
    pose[:, 0] = np.array([0, 1, 0]) * turn * s[:, 0]
    translation = 0.1 * np.concatenate([np.sin(3 * s), 0.2 * np.sin(6 * s), np.cos(2 * s)], axis=2)[:, 0]
    shape = rng.normal(0, 0.8, 10)
    return Actor(shape, pose, translation, model.pose(shape, np.zeros(10), pose, translation))


def detections(
    model: BodyModel, cameras: Cameras, posed: Posed, *, seed: int, noise: float = 1.5, wrong: float = 0.1
) -> tuple[np.ndarray, np.ndarray]:
    """Keypoints [frame,camera,133,2] px with Gaussian noise [px] and a share of wrong ones, and scores that tell little about which."""
    rng = np.random.default_rng(seed)
    x = keypoints133(model, posed.vertices, posed.joints)
    uv = np.moveaxis(project(cameras, x)[0], 0, 1)
    uv = uv + rng.normal(0, noise, uv.shape)
    lost = rng.uniform(size=uv.shape[:3]) < wrong
    uv[lost] = rng.uniform(0, SIZE, (lost.sum(), 2))
    return uv, np.where(lost, rng.uniform(0.3, 1, lost.shape), rng.uniform(0.6, 1, lost.shape))
