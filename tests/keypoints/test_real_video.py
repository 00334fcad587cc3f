"""The bundled detector on real video of one person in four views, with another figure and a skeleton in the background of two."""

import os
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from tasks.capture.calibrated_video import read_calibrated_video
from tasks.keypoints.detector import Detector
from tasks.keypoints.person_box import moving_person, temporal_median
from tasks.keypoints.rig_keypoints import agreed_points, follow_motion

DATA = Path(os.environ.get("PHYSAVATAR_REAL_DATA", Path(__file__).parents[3] / "shared/data")) / "multiview"
HEAD = np.array([[487, 335], [590, 440], [603, 475], [232, 570]])  # [px] the cap in frame 0 of the four views, read off by eye
BYSTANDERS = np.array([[65, 470], [805, 560]])  # [px] heads of the other figure in the first two views
LEG_MEDIAN = 0.03  # of the box's diagonal; measured 0.015

pytestmark = [pytest.mark.slow, pytest.mark.skipif(not DATA.is_dir(), reason=f"no real recordings at {DATA}")]


@pytest.fixture(scope="module")
def clip():
    recording = read_calibrated_video(DATA / "Calib.qca.txt", frames=list(range(0, 100, 10)))
    return recording.cameras, [[recording.read_rgb(camera, t) for camera in range(4)] for t in range(10)]


@pytest.fixture(scope="module")
def seek(clip):
    cameras, frames = clip
    return partial(moving_person, cameras, [temporal_median(list(view)) for view in zip(*frames, strict=True)])


def test_the_walking_man_is_boxed_in_every_view_and_nobody_else(clip, seek):
    boxes = seek(clip[1][0])
    for box, head in zip(boxes, HEAD):
        assert box[0] - 30 < head[0] < box[2] + 30 and box[1] - 60 < head[1] < box[3]
    for box, other in zip(boxes, BYSTANDERS):
        assert not (box[0] < other[0] < box[2] and box[1] < other[1] < box[3])


def test_views_agree_on_the_legs(clip, seek):
    """Hips, knees, ankles: the median distance between where a view sees them and where the views together put them."""
    cameras, frames = clip
    found = follow_motion(Detector.load(), cameras, frames, seek)
    residual = np.stack([agreed_points(cameras, uv, score, scale=15.0)[1] for uv, score in zip(found.uv, found.score)])
    legs = residual[:, :, 11:17]
    height = np.median(np.linalg.norm(found.box[..., 2:] - found.box[..., :2], axis=-1))
    assert np.median(legs) < LEG_MEDIAN * height
    mirrored = found.uv.copy()  # negative control: the third view calls left right
    mirrored[:, 2, 11:17] = found.uv[:, 2, [12, 11, 14, 13, 16, 15]]
    worse = np.stack([agreed_points(cameras, uv, score, scale=15.0)[1] for uv, score in zip(mirrored, found.score)])
    assert np.median(worse[:, 2, 11:17]) > 2 * np.median(legs[:, 2])
