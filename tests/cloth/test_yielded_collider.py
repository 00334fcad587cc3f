"""A collider that gives way as it is once effects have moved it."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth import windowed_fit
from tasks.cloth.start_state import States
from tasks.cloth.windows import Recording
from tasks.cloth.yielded_collider import with_yielded_collider, yielded_everywhere
from tasks.effects.effect import Motion, Subject
from tasks.effects.library import library
from tasks.effects.model import Model
from tasks.geometry.distances import inside
from tasks.simulator import Cloth, Collider, Fabric, Settings
from tests.cloth.test_contact_sagitta import FPS, tube
from tests.cloth.test_gauss_newton import TRUTH, panel
from tests.simulator.scenes import sheet

RADIUS, GAP = 0.05, 0.012
OFFSET, DELAY = library()["body_offset"], library()["observation_delay"]


@pytest.fixture(scope="module")
def limbs():
    """Two parallel limbs 12 mm apart with a sheet beside them: model, recording."""
    x, faces = tube(RADIUS, around=60, along=12)
    other = x + np.array([2 * RADIUS + GAP, 0, 0])
    both = np.concatenate([x, other])
    two = np.concatenate([faces, faces + len(x)]).astype(np.int32)
    cloth_x, cloth_faces = sheet(5, 5, length=0.1, width=0.1)
    near = cloth_x - cloth_x.mean(0) + (RADIUS + GAP / 2, RADIUS + 0.02, 0)
    subject = Subject(Cloth(cloth_x, cloth_faces, np.arange(5)), Fabric(), Collider(two), np.full(25, "free"), FPS)
    T = 2
    motion = Motion(np.repeat(both[None], T, 0), np.repeat(near[None, :5], T, 0))
    return Model(subject, Settings(yield_collider=False)), Recording(
        Collider(two), motion, np.repeat(near[None], T, 0), np.full((T, 25), 1e-3)
    )


def buried(model, recording, frame=0):
    """How many of the collider's middle vertices lie in the other limb, as the model drives it."""
    c = recording.scene(model).driven(recording.motion).collider[frame]
    middle = np.abs(c[:, 2]) < 0.1
    half = len(c) // 2
    faces = recording.collider.faces[: len(recording.collider.faces) // 2]
    return int(inside(c[half:][middle[half:]], c[:half], faces).sum())


def test_limbs_that_are_apart_stay_as_they_were_recorded(limbs):
    model, recording = limbs
    np.testing.assert_array_equal(with_yielded_collider(recording, model).motion.given_way.collider, recording.motion.collider)


@pytest.mark.parametrize("yielded", [with_yielded_collider, yielded_everywhere])
def test_limbs_that_an_effect_makes_thicker_do_not_grow_into_one_another(limbs, yielded):
    model, recording = limbs
    thick = replace(model, effects=(OFFSET,), strengths={OFFSET.name: np.array([0.01])})
    assert buried(thick, recording) > 0
    assert buried(thick, yielded(recording, thick)) == 0
    far = np.abs(yielded(recording, thick).motion.yielded[0]).max(1) == 0
    assert far.mean() > 0.5  # what touches nothing stays


@pytest.mark.parametrize("yielded", [with_yielded_collider, yielded_everywhere])
def test_limbs_that_touch_for_a_moment_give_way_when_a_late_garment_meets_that_moment(limbs, yielded):
    """By what they gave way two frames before or after, one would still be in the other, and skin that touches nothing drawn in."""
    model, recording = limbs
    T, touch, late = 8, 3, 2
    path = np.repeat(recording.motion.collider[:1], T, 0)
    half = path.shape[1] // 2
    path[touch, half:, 0] -= 2 * GAP
    still = replace(
        recording, motion=Motion(path, np.repeat(recording.motion.boundary[:1], T, 0)), observed=np.repeat(recording.observed[:1], T, 0)
    )
    delayed = replace(model, effects=(DELAY,), strengths={DELAY.name: np.array([late / FPS])})
    assert buried(delayed, still, touch + late) > 0
    found = yielded(still, delayed)
    assert [buried(delayed, found, t) for t in range(T)] == [0] * T
    assert [bool(depth.any()) for depth in found.motion.yielded] == [t == touch + late for t in range(T)]


def test_what_a_collider_gave_way_by_to_another_model_is_not_added(limbs):
    model, recording = limbs
    thick = replace(model, effects=(OFFSET,), strengths={OFFSET.name: np.array([0.01])})
    once = with_yielded_collider(recording, model)
    np.testing.assert_array_equal(
        with_yielded_collider(with_yielded_collider(once, thick), thick).motion.yielded, with_yielded_collider(once, thick).motion.yielded
    )
    np.testing.assert_array_equal(with_yielded_collider(with_yielded_collider(once, thick), model).motion.yielded, once.motion.yielded)


def test_some_frames_of_a_collider_give_way_as_they_did(limbs):
    model, recording = limbs
    found = with_yielded_collider(recording, replace(model, effects=(OFFSET,), strengths={OFFSET.name: np.array([0.01])})).motion
    np.testing.assert_array_equal(found.cut(slice(1, 2)).given_way.collider, found.given_way.collider[1:2])


def test_a_fabric_is_fitted_before_the_body_as_it_gave_way(monkeypatch):
    scene = panel(3, frames=8)
    scene = replace(scene, collider=Collider(np.array([[0, 1, 2]], np.int32)), collider_motion=np.tile(np.eye(3) - 9.0, (8, 1, 1)))
    met = []

    def gave_way(recording, model):
        return replace(recording, motion=replace(recording.motion, yielded=np.full((8, 3, 3), 0.01)))

    def walked(model, motion, observed, noise):
        met.append(motion.collider)
        return States(observed[:1], observed[:1], "no further")

    monkeypatch.setattr(windowed_fit, "with_yielded_collider", gave_way)
    monkeypatch.setattr(windowed_fit, "states", walked)
    windowed_fit._cut(replace(scene, settings=replace(scene.settings, yield_collider=True)), TRUTH)
    np.testing.assert_array_equal(met, [scene.collider_motion + 0.01])
