"""Motions to record next: rigid where they should be, as recorded where they begin, and as fast as they say."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth.windows import Recording
from tasks.effects.effect import Motion
from tasks.gap.next_motions import SWAY, next_motions
from tasks.simulator import NO_COLLIDER

FPS, T, V = 30.0, 61, 5


@pytest.fixture
def recorded():
    t = np.arange(T)[:, None, None] / FPS
    pose = np.random.default_rng(0).normal(size=(1, 4, 3))
    body = pose + np.sin(3 * t) * (0.1, 0.0, 0.05)
    observed = np.random.default_rng(1).normal(size=(1, V, 3)) + 0 * t
    return Recording(NO_COLLIDER, Motion(body, body[:, :2]), observed, np.full((T, V), 1e-3))


def by_name(recorded, frames):
    x0, v0 = recorded.observed[0], np.full((V, 3), 3.0)
    return {m.said: m for m in next_motions(recorded, x0, v0, frames, FPS)}


def test_all_but_the_other_way_begin_where_the_recording_begins(recorded):
    for said, m in by_name(recorded, 20).items():
        if "facing" not in said:
            np.testing.assert_allclose(m.motion.collider[0], recorded.motion.collider[0], atol=1e-12)
            np.testing.assert_allclose(m.motion.boundary[0], recorded.motion.boundary[0], atol=1e-12)
            np.testing.assert_array_equal(m.x0, recorded.observed[0])


def test_they_begin_before_the_body_as_it_gave_way(recorded):
    yielded = np.full_like(recorded.motion.collider, 0.01)
    gave = replace(recorded, motion=replace(recorded.motion, yielded=yielded))
    for said, m in by_name(gave, 20).items():
        assert m.motion.yielded is None
        if "facing" not in said:
            np.testing.assert_allclose(m.motion.collider[0], recorded.motion.collider[0] + 0.01, atol=1e-12)


def test_other_speeds_pass_the_same_places_and_start_as_fast(recorded):
    found, path = by_name(recorded, 25), recorded.motion.collider
    fast, slow = found["the same motion at twice the speed"], found["the same motion at half the speed"]
    np.testing.assert_allclose(fast.motion.collider, path[:49:2], atol=1e-12)
    np.testing.assert_allclose(slow.motion.collider[::2], path[:13], atol=1e-12)
    assert (fast.v0 == 6).all() and (slow.v0 == 1.5).all()
    between = path[:1] + np.sin(3 * 0.5 / FPS * np.arange(25))[:, None, None] * (0.1, 0.0, 0.05)
    np.testing.assert_allclose(slow.motion.collider, between, atol=1e-5)
    np.testing.assert_array_equal(slow.motion.boundary, slow.motion.collider[:, :2])


def test_no_motion_goes_on_where_the_recording_has_ended(recorded):
    found = by_name(recorded, 50)
    assert len(found["the same motion at twice the speed"].motion.boundary) == 31
    assert len(found["the same motion at half the speed"].motion.boundary) == 50


def test_facing_the_other_way_is_a_half_turn_of_all(recorded):
    other, x0 = by_name(recorded, 20)["the same motion, facing the other way"], recorded.observed[0]
    centre = x0.mean(0) * (1, 0, 1)

    def turned(x):
        return (x - centre) * (-1, 1, -1) + centre

    np.testing.assert_allclose(other.motion.collider, turned(recorded.motion.collider[:20]), atol=1e-12)
    np.testing.assert_allclose(other.x0, turned(x0), atol=1e-12)
    np.testing.assert_allclose(other.v0, np.full((V, 3), 3.0) * (-1, 1, -1), atol=1e-12)


@pytest.mark.parametrize(("word", "axis"), [("aside", 0), ("lifted", 1)])
def test_a_carried_pose_moves_as_one_there_and_back(recorded, word, axis):
    (m,) = (m for said, m in by_name(recorded, 31).items() if word in said)
    moved = m.motion.collider - recorded.motion.collider[:1]
    np.testing.assert_allclose(moved, moved[:, :1] * np.ones((1, 4, 1)), atol=1e-12)
    assert moved[15, 0, axis] == pytest.approx(SWAY) and abs(moved[30, 0]).max() < 1e-12
    assert (m.v0 == 0).all() and m.motion.boundary.shape == (31, 2, 3)


def test_a_turned_pose_keeps_its_shape_and_its_height(recorded):
    (m,) = (m for said, m in by_name(recorded, 31).items() if "quarter" in said)
    pose, there = recorded.motion.collider[0], m.motion.collider[15]
    np.testing.assert_allclose(there[:, 1], pose[:, 1], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(there[0] - there, axis=-1), np.linalg.norm(pose[0] - pose, axis=-1), atol=1e-12)
    flat, now = ((p[0] - p[1])[[0, 2]] for p in (pose, there))
    assert flat @ now == pytest.approx(0.0, abs=1e-12)  # a quarter round


def test_without_a_body_or_with_one_frame_there_is_nothing_to_interpolate(recorded):
    bare = replace(recorded, motion=Motion(np.zeros((T, 0, 3)), recorded.motion.boundary))
    assert {m.motion.collider.shape[1:] for m in by_name(bare, 12).values()} == {(0, 3)}
    single = recorded.cut(slice(0, 1))
    assert len(by_name(single, 12)["the same motion at twice the speed"].motion.boundary) == 1


def test_a_still_pose_is_still(recorded):
    still = by_name(recorded, 12)["the first pose held still"].motion
    np.testing.assert_allclose(still.collider, np.broadcast_to(recorded.motion.collider[0], (12, 4, 3)), atol=1e-12)
