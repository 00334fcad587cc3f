"""A tiny recording in ActorsHQ layout: a box in front of four cameras, two frames of 48 × 64 pixels. Real files, nothing mocked."""

from pathlib import Path

import cv2
import numpy as np

from tasks.capture.calibration_actorshq import write_calibration_csv
from tasks.capture.calibration_opencv import write_opencv
from tasks.capture.template import Template, write_obj
from tests.geometry.test_cameras import ring
from tests.geometry.test_meshes import CUBE, CUBE_FACES

CAMERAS, FRAMES = 4, 2


def tiny_recording(data: Path, actor: str = "ann", sequence: str = "one") -> Path:
    """Write it below `data`; returns the folder of the sequence."""
    folder = data / actor / sequence
    rig = ring(CAMERAS, distorted=False).scaled(0.1)
    for kind in ("rgbs", "masks"):
        for name in rig.names:
            (folder / "1x" / kind / name).mkdir(parents=True)
    write_calibration_csv(folder / "1x" / "calibration.csv", rig)
    for name, (width, height) in zip(rig.names, rig.size.tolist()):
        mask = np.zeros((height, width), np.uint8)
        mask[height // 4 : -height // 4, width // 4 : -width // 4] = 255
        for frame in range(FRAMES):
            picture = np.where(mask[..., None] > 0, np.random.default_rng(frame).integers(40, 200, (height, width, 3)), 0).astype(np.uint8)
            cv2.imwrite(str(folder / f"1x/rgbs/{name}/{name}_rgb{frame:06d}.jpg"), picture)
            cv2.imwrite(str(folder / f"1x/masks/{name}/{name}_mask{frame:06d}.png"), mask)
    box = "aabb_min_x,aabb_min_y,aabb_min_z,aabb_max_x,aabb_max_y,aabb_max_z"
    rows = "".join(f"{frame},-0.5,-0.9,-0.5,0.5,0.9,0.5\n" for frame in range(FRAMES))
    (folder / "aabbs.csv").write_text(f"frame_number,{box}\n{rows}")
    (folder / "template").mkdir()
    write_obj(folder / "template/template.obj", Template(CUBE - 0.5, CUBE_FACES, np.zeros((0, 2)), CUBE_FACES[:0], np.full(12, "body")))
    return folder


def tiny_videos(data: Path, actor: str = "bob", sequence: str = "one") -> Path:
    """The same rig as calibrated video: `calibration.json` and one mp4 per camera; returns the folder of the sequence."""
    folder = data / actor / sequence
    folder.mkdir(parents=True)
    rig = ring(CAMERAS, distorted=False).scaled(0.1)
    write_opencv(folder / "calibration.json", rig)
    for name, (width, height) in zip(rig.names, rig.size.tolist()):
        writer = cv2.VideoWriter(str(folder / f"{name}.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 30.0, (width, height))
        for frame in range(FRAMES):
            writer.write(np.random.default_rng(frame).integers(40, 200, (height, width, 3), np.uint8))
        writer.release()
    return folder
