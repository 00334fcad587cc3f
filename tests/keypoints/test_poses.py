"""Random poses keep to what joints can do, and are as varied as they claim."""

import numpy as np
import pytest

from tasks.body.skeleton import JOINT
from tasks.geometry.rotations import matrix_from_axis_angle
from tasks.keypoints.poses import random_pose


@pytest.fixture(scope="module")
def poses() -> np.ndarray:
    random = np.random.default_rng(0)
    return np.stack([random_pose(random) for _ in range(300)])


def test_same_seed_same_pose():
    np.testing.assert_array_equal(random_pose(np.random.default_rng(5)), random_pose(np.random.default_rng(5)))


def test_knees_bend_backwards_only(poses):
    knees = poses[:, [JOINT["left_knee"], JOINT["right_knee"]]]
    assert np.abs(knees[..., 1:]).max() < 1e-9
    assert knees[..., 0].min() > -1e-9 and np.rad2deg(knees[..., 0].max()) <= 135.1


@pytest.mark.parametrize("side", ["left", "right"])
def test_elbows_bend_forwards_only(poses, side):
    """The bent forearm points to the front of the arm (+z of the rest pose), never to its back."""
    along = np.array([1.0 if side == "left" else -1.0, 0, 0])
    forearm = matrix_from_axis_angle(poses[:, JOINT[f"{side}_elbow"]]) @ along
    assert forearm[:, 2].min() > -1e-9
    assert np.rad2deg(np.arccos(forearm @ along)).max() < 141


@pytest.mark.parametrize("side", ["left", "right"])
def test_fingers_curl_into_the_palm(poses, side):
    """Palms face down in the rest pose: the first joint of each finger bends down, at most 5° up."""
    along = np.array([1.0 if side == "left" else -1.0, 0, 0])
    for finger in ("index", "middle", "ring", "pinky"):
        bone = matrix_from_axis_angle(poses[:, JOINT[f"{side}_{finger}1"]]) @ along
        assert np.rad2deg(np.arcsin(bone[:, 1])).max() < 5.1


def test_arms_reach_everywhere_and_legs_leave_the_ground(poses):
    R = matrix_from_axis_angle(poses)
    up = (R[:, JOINT["left_collar"]] @ R[:, JOINT["left_shoulder"]] @ [1.0, 0, 0])[:, 1]
    assert up.min() < -0.95 and up.max() > 0.9
    assert (np.rad2deg(np.abs(poses[:, JOINT["left_hip"], 0])) > 60).mean() > 0.05
