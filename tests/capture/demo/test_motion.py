"""The dance: it begins from standing still, is smooth, repeats, keeps the standing foot in place; limbs reach what they are told to."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tasks.body.skeleton import PARENTS
from tasks.capture.demo.limbs import two_bone_limb
from tasks.capture.demo.motion import ATTACK, PERIOD, dance, envelope
from tasks.geometry.rotations import axis_angle_from_matrix, matrix_from_axis_angle
from tests.capture.test_bvh import forward, t_pose

FPS = 100.0


@pytest.fixture(scope="module")
def motion():
    return dance(t_pose(), PARENTS, sole=-1.0, frames=400, fps=FPS)


@pytest.fixture(scope="module")
def joints(motion) -> np.ndarray:
    return forward(t_pose(), motion)


def test_it_begins_at_rest(joints) -> None:
    """Velocity and acceleration of all joints vanish at the first frame; a motion that started at full swing has 1 m/s there."""
    fast = 1000.0
    v = np.diff(forward(t_pose(), dance(t_pose(), PARENTS, sole=-1.0, frames=3, fps=fast)), axis=0) * fast
    assert np.abs(v[0]).max() < 0.005
    assert np.abs(np.diff(v, axis=0)[0]).max() * fast < 1.0
    assert np.abs(np.diff(joints, axis=0)).max() * FPS > 0.5


def test_it_is_smooth(motion) -> None:
    """Between frames 10 ms apart no joint turns by more than 6 degrees, and its angular velocity changes by less than half of that."""
    R = matrix_from_axis_angle(motion.pose)
    turns = axis_angle_from_matrix(np.swapaxes(R[:-1], -1, -2) @ R[1:])
    assert np.degrees(np.linalg.norm(turns, axis=-1)).max() < 6
    assert np.degrees(np.linalg.norm(np.diff(turns, axis=0), axis=-1)).max() < 3


def test_it_repeats_after_the_attack(joints) -> None:
    first, period = round(ATTACK * FPS), round(PERIOD * FPS)
    assert_allclose(joints[first : first + period], joints[first + period : first + 2 * period], atol=1e-9)
    assert np.abs(joints[first : first + period // 2] - joints[first + period // 2 : first + period]).max() > 0.05


def test_the_standing_foot_does_not_slide(joints) -> None:
    """At any time at least one ankle is where it stood in the first frame, and each leaves the floor at some time."""
    moved = np.linalg.norm(joints[:, [7, 8]] - joints[:1, [7, 8]], axis=2)
    assert moved.min(1).max() < 1e-9
    assert (moved.max(0) > 0.03).all()


def test_without_energy_nobody_moves() -> None:
    still = dance(t_pose(), PARENTS, sole=-1.0, frames=50, energy=0.0)
    assert_allclose(still.pose, np.broadcast_to(still.pose[0], still.pose.shape), atol=1e-12)
    assert_allclose(forward(t_pose(), still)[0, [7, 8], 1], 0.1, atol=1e-9)  # ankles at -0.9 over soles at -1.0


def test_envelope_is_twice_differentiable_at_both_ends() -> None:
    t = np.array([0.0, ATTACK])
    for h in (1e-3, 1e-4):
        second = (envelope(t + h) - 2 * envelope(t) + envelope(t - h)) / h**2
        assert np.abs(second).max() < 400 * h
    assert_allclose(envelope(t), [0, 1])


def test_a_limb_reaches_its_target_with_its_bones() -> None:
    rng = np.random.default_rng(3)
    rest = np.array([[0, 0, 0], [0.05, -0.4, 0.02], [0, -0.8, 0]])
    root, target = rng.normal(0, 0.1, (20, 3)), np.array([0, -0.5, 0]) + rng.normal(0, 0.1, (20, 3))
    facing = np.tile([0.1, 0.2, 1.0], (20, 1))
    upper, lower = two_bone_limb(root, target, rest, facing, rest_facing=np.array([0, 0, 1.0]))
    knee = root + upper @ (rest[1] - rest[0])
    assert_allclose(knee + lower @ (rest[2] - rest[1]), target, atol=1e-12)
    bent = knee - (root + target) / 2
    assert (np.sum(bent * facing, 1) > 0).all()
    assert_allclose(np.linalg.det(upper), 1)


def test_a_limb_stretches_towards_what_it_cannot_reach() -> None:
    rest = np.array([[0, 0, 0], [0, -0.4, 0], [0, -0.8, 0.0]])
    upper, lower = two_bone_limb(
        np.zeros((1, 3)), np.array([[2.0, 0, 0]]), rest, np.array([[0, 0, 1.0]]), rest_facing=np.array([0, 0, 1.0])
    )
    end = upper @ (rest[1] - rest[0]) + lower @ (rest[2] - rest[1])
    assert_allclose(end, [[0.8 * 0.999, 0, 0]], atol=1e-12)
