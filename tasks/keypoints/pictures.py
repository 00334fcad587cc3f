"""Training pictures on disk: shards of JPEGs with their keypoints, made once and read many times.

One shard is an .npz with `jpeg` (all files end to end), `start` [N+1], `keypoints` [N,133,2] px, `visible` [N,133], `seed`.
Shard s of seed S depends on (S, s) alone, so that several processes may share the work and a broken run goes on where it stopped.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from tasks.keypoints.renders import Picture, Studio

SHARD = 500  # pictures per file
VIEWS = 3  # pictures of one person


@dataclass(frozen=True)
class Shard:
    """Pictures of one file, kept compressed: `jpeg` [byte], `start` [N+1], `keypoints` [N,133,2] px, `visible` [N,133]."""

    jpeg: np.ndarray
    start: np.ndarray
    keypoints: np.ndarray
    visible: np.ndarray

    def __len__(self) -> int:
        return len(self.keypoints)

    def picture(self, k: int) -> Picture:
        """Picture k, RGB."""
        data = self.jpeg[self.start[k] : self.start[k + 1]]
        return Picture(cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1], self.keypoints[k].astype(float), self.visible[k])


def write_shards(studio: Studio, folder: Path, shards: range, *, seed: int) -> None:
    """Render the shards that are not yet in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    for s in shards:
        path = folder / f"shard_{s:04d}.npz"
        if not path.exists():
            random = np.random.default_rng([seed, s])
            studio.bystanders.clear()
            pictures = []
            while len(pictures) < SHARD:
                person = studio.person(random)
                pictures += [studio.picture(person, random) for _ in range(VIEWS)]
            aside = path.with_suffix(f".{os.getpid()}.tmp.npz")
            np.savez(aside, **_packed(pictures[:SHARD], random))
            aside.replace(path)


def read_shard(path: Path) -> Shard:
    """One shard, still compressed."""
    with np.load(path) as data:
        return Shard(data["jpeg"], data["start"], data["keypoints"], data["visible"])


def _packed(pictures: list[Picture], random: np.random.Generator) -> dict[str, np.ndarray]:
    files = [
        cv2.imencode(".jpg", p.image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, int(random.integers(55, 96))])[1].ravel() for p in pictures
    ]
    return {
        "jpeg": np.concatenate(files),
        "start": np.cumsum([0, *(len(f) for f in files)]),
        "keypoints": np.stack([p.keypoints for p in pictures]).astype(np.float32),
        "visible": np.stack([p.visible for p in pictures]),
    }
