"""The figures of tasks/keypoints/README.md, printed by `python -m tests.keypoints.figures [people]`: held-out renders, then real video."""

import os
import sys
from functools import partial
from pathlib import Path

import numpy as np

from tasks.body.anny_body import build_demo_body
from tasks.body.model import BodyModel
from tasks.body.wholebody import NAMES
from tasks.capture.calibrated_video import read_calibrated_video
from tasks.keypoints.accuracy import group_table
from tasks.keypoints.augmentation import centred
from tasks.keypoints.detector import Detector
from tasks.keypoints.person_box import moving_person, temporal_median
from tasks.keypoints.renders import Studio
from tasks.keypoints.rig_keypoints import BODY, agreed_points, follow_motion
from tests.keypoints.test_real_video import DATA

SEED = 777  # training used seed 1


def held_out(people: int) -> None:
    cache = Path(os.environ.get("PHYSAVATAR_CACHE", Path.home() / ".cache/physavatar"))
    studio, random = Studio(BodyModel.load(build_demo_body(cache)), shapes=10, expressions=10), np.random.default_rng(SEED)
    pictures = [studio.picture(studio.person(random), random) for _ in range(people)]
    crops = [centred(picture.image, picture.keypoints) for picture in pictures]
    found = [Detector.load().read_crop(crop) for crop, _ in crops]
    uv, score = (np.stack(part) for part in zip(*found))
    truth, visible = np.stack([truth for _, truth in crops]), np.stack([picture.visible for picture in pictures])
    print("keypoints  shown   PCK@0.05  PCK@0.1  median px (crop of 192 x 256) | hidden  PCK@0.1")
    shown, hidden = group_table(uv, truth, visible), group_table(uv, truth, ~visible)
    for name, row in shown.items():
        print(
            f"{name:10s} {row['count']:5d}   {row['pck05']:.3f}     {row['pck10']:.3f}    {row['median_px']:.1f}"
            f"                           | {hidden[name]['count']:5d}   {hidden[name]['pck10']:.3f}"
        )
    error = np.linalg.norm(uv - truth, axis=-1)[:, BODY]
    for low, high in ((0, 0.3), (0.3, 0.5), (0.5, 0.7), (0.7, 2)):
        part = (score[:, BODY] >= low) & (score[:, BODY] < high) & visible[:, BODY]
        print(f"score {low:.1f}-{high:.1f}: {part.sum():5d} body and feet points, {np.mean(error[part] > 10):.2f} of them off by > 10 px")


def real_video() -> None:
    recording = read_calibrated_video(DATA / "Calib.qca.txt", frames=list(range(0, 100, 5)))
    frames = [[recording.read_rgb(camera, t) for camera in range(4)] for t in range(20)]
    seek = partial(moving_person, recording.cameras, [temporal_median(list(view)) for view in zip(*frames, strict=True)])
    found = follow_motion(Detector.load(), recording.cameras, frames, seek)
    residual = np.stack([agreed_points(recording.cameras, uv, score, scale=15.0)[1] for uv, score in zip(found.uv, found.score)])
    print("median reprojection error [px of 1088 x 1920] per camera, 20 frames")
    for k in range(BODY.stop):
        print(f"{NAMES[k]:16s}", np.nanmedian(residual[:, :, k], axis=0).round(1), "score", found.score[:, :, k].mean(0).round(2))
    for name, points in (("body and feet", np.arange(23)), ("face", np.arange(23, 91)), ("hands", np.arange(91, 133))):
        print(
            f"{name:16s}", np.nanmedian(residual[:, :, points], axis=(0, 2)).round(1), "all", np.nanmedian(residual[:, :, points]).round(1)
        )


if __name__ == "__main__":
    held_out(int(sys.argv[1]) if len(sys.argv) > 1 else 300)
    if DATA.is_dir():
        real_video()
