"""Views that took back for front are turned round by the others, and by nothing else."""

import numpy as np

from tasks.body.wholebody import FLIP
from tasks.geometry.cameras import project
from tasks.keypoints.rig_keypoints import RigKeypoints
from tasks.keypoints.sides import same_sides
from tests.geometry.test_cameras import ring


def rig_keypoints(*, swapped: list[tuple[int, int]], noise: float = 3.0):
    random = np.random.default_rng(3)
    cameras = ring(6, distorted=False)
    x = random.normal(scale=0.3, size=(133, 3)) * [1, 1.5, 0.4]
    x[FLIP] = x * [-1, 1, 1] * 0.5 + x[FLIP] * 0.5 + [0, 0, 0]  # sides lie apart, whatever they are
    uv = np.stack([project(cameras, x)[0] + random.normal(scale=noise, size=(6, 133, 2)) for _ in range(3)])
    true = uv.copy()
    for frame, camera in swapped:
        uv[frame, camera] = uv[frame, camera][FLIP]
    boxes = np.concatenate([uv.min(2), uv.max(2)], -1)
    return cameras, RigKeypoints(uv, np.ones(uv.shape[:3]), boxes), true


def test_swapped_views_are_turned_back():
    swapped = [(0, 1), (0, 4), (2, 0)]
    cameras, found, true = rig_keypoints(swapped=swapped)
    mended, turned = same_sides(cameras, found)
    assert sorted(map(tuple, np.argwhere(turned).tolist())) == swapped
    np.testing.assert_array_equal(mended.uv, true)


def test_views_that_agree_are_left_alone():
    cameras, found, _ = rig_keypoints(swapped=[])
    mended, turned = same_sides(cameras, found)
    assert not turned.any()
    np.testing.assert_array_equal(mended.uv, found.uv)
