"""A body in the wrong place, seen by the cloth that was observed inside it."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth.windows import Recording
from tasks.effects.effect import Motion, Subject
from tasks.effects.library import library, suspects
from tasks.effects.model import Model
from tasks.gap.interpenetration import cleared, depth
from tasks.simulator import NO_COLLIDER, Cloth, Collider, Fabric, Settings
from tests.cloth.test_contact_sagitta import tube
from tests.simulator.scenes import sheet

RADIUS, FPS, T = 0.05, 30.0, 19
LIBRARY = library()


def scene(gap, speed=0.0, late=0.0):
    """A sheet at `gap` [m] around a tube that swings by `speed` [m/s]; the sheet is where the tube was `late` [s] ago."""
    x, faces = sheet(7, 7, length=0.05, width=0.05)
    flat = x - x.mean(0)
    order = np.argsort(np.ptp(flat, axis=0))[::-1]
    φ = flat[:, order[0]] / RADIUS
    around = np.stack([(RADIUS + gap) * np.cos(φ), (RADIUS + gap) * np.sin(φ), flat[:, order[1]]], -1)
    body, body_faces = tube(RADIUS)

    def place(t):
        return np.stack([speed / 6 * np.sin(6 * t), 0 * t, 0 * t], -1)[:, None]

    t = np.arange(T) / FPS
    recording = Recording(
        Collider(body_faces), Motion(body + place(t), np.zeros((T, 0, 3))), around + place(t - late), np.full((T, len(x)), 5e-4)
    )
    cloth = Cloth(x, faces, np.empty(0, np.int32))
    return Model(Subject(cloth, Fabric(320.0, 4.0, 60.0), NO_COLLIDER, np.full(len(x), "free"), FPS), Settings()), recording


def test_depth_is_that_of_the_cloth():
    model, recording = scene(-0.006)
    assert depth(model, [recording]) == pytest.approx(0.006, rel=0.05)
    model, recording = scene(0.003)
    assert depth(model, [recording]) == 0.0


def test_a_body_too_large_is_cleared_by_making_it_thinner():
    model, recording = scene(-0.006)
    found = cleared(model, [recording], suspects(LIBRARY.values()), 5e-4)
    assert found["body_offset"] == pytest.approx(-0.006, abs=0.002)
    assert "contact_thickness" not in found  # it only ever makes the body larger


def test_a_garment_recorded_late_is_cleared_by_its_delay():
    model, recording = scene(0.0005, speed=0.6, late=0.05)
    found = cleared(model, [recording], suspects(LIBRARY.values()), 5e-4)
    assert found["observation_delay"] == pytest.approx(0.05, abs=0.02)
    assert found["body_lag"] == pytest.approx(-found["observation_delay"])


def test_nothing_is_told_of_a_body_in_its_place():
    model, recording = scene(0.001)
    noisy = replace(recording, observed=recording.observed + 5e-4 * np.random.default_rng(0).standard_normal(recording.observed.shape))
    assert cleared(model, [noisy], suspects(LIBRARY.values()), 5e-4) == {}


def test_what_the_base_does_to_the_body_already_stands_beside_what_is_tried():
    """A base that has the body 20 mm thinner leaves a delay of 50 ms to be seen; tried on the bare body, no delay clears it."""
    model, recording = scene(-0.0195, speed=0.4, late=0.05)
    given = model.joined([LIBRARY["body_offset"]], {"body_offset": np.array([-0.02])})
    found = cleared(given, [recording], [LIBRARY["observation_delay"]], 5e-4)
    assert found["observation_delay"] == pytest.approx(0.05, abs=0.02)
