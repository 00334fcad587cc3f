"""Coarse cloth on a cylinder: how far its edges hold its vertices off."""

import numpy as np
import pytest

from tasks.cloth.contact_sagitta import body_speed, contact_sagitta, drawn_in
from tasks.cloth.windows import Recording
from tasks.effects.effect import Motion
from tasks.simulator import NO_COLLIDER, Cloth, Collider
from tests.simulator.scenes import sheet

RADIUS, EDGE, FPS = 0.05, 0.025, 30.0


def tube(radius, around=200, along=20):
    """A fine cylinder about the z axis: vertices, faces."""
    φ, z = np.linspace(0, 2 * np.pi, around, endpoint=False), np.linspace(-0.15, 0.15, along)
    x = np.stack(
        [radius * np.cos(φ)[None] + 0 * z[:, None], radius * np.sin(φ)[None] + 0 * z[:, None], z[:, None] + 0 * φ[None]], -1
    ).reshape(-1, 3)
    a = (np.arange(along - 1)[:, None] * around + np.arange(around)).ravel()
    b = (np.arange(along - 1)[:, None] * around + (np.arange(around) + 1) % around).ravel()
    return x, np.concatenate([np.stack([a, b, b + around], 1), np.stack([a, b + around, a + around], 1)]).astype(np.int32)


@pytest.fixture(scope="module")
def laid():
    """A sheet with edges of `EDGE` laid around the cylinder, chords along the axis and around it."""
    x, faces = sheet(5, 9, length=4 * EDGE, width=8 * EDGE)
    flat = x - x.mean(0)
    across = flat[:, np.argsort(np.ptp(flat, axis=0))[::-1]]  # longest side around
    φ = across[:, 0] / RADIUS
    on = np.stack([RADIUS * np.sin(φ), RADIUS * np.cos(φ), across[:, 1]], -1)
    body, body_faces = tube(RADIUS)
    collider = body[None] + np.zeros((6, 1, 1))
    motion = Motion(collider, np.zeros((6, 0, 3)))
    return Cloth(x, faces, np.empty(0, np.int32)), Recording(
        Collider(body_faces), motion, np.repeat(on[None], 6, 0), np.full((6, len(x)), 1e-3)
    )


def test_edges_around_a_cylinder_stand_off_by_the_sagitta(laid):
    cloth, recording = laid
    s = EDGE**2 / (8 * RADIUS)
    # edges around and diagonals have it, edges along the axis have none
    assert 0.55 * s < contact_sagitta(cloth, [recording], 0.0) < 0.75 * s
    assert contact_sagitta(cloth, [recording], 1e-3) - contact_sagitta(cloth, [recording], 0.0) == pytest.approx(0.5e-3)


def test_nothing_stands_off_where_nothing_is_touched(laid):
    cloth, recording = laid
    away = Recording(recording.collider, recording.motion, recording.observed + np.array([0, 0.1, 0]), recording.noise)
    assert contact_sagitta(cloth, [away], 1e-3) == 0.0
    free = Recording(NO_COLLIDER, Motion(np.zeros((6, 0, 3)), recording.motion.boundary), recording.observed, recording.noise)
    assert contact_sagitta(cloth, [free], 1e-3) == 0.0
    assert drawn_in(free, 0.01) is free


def test_a_body_is_drawn_in_by_the_distance(laid):
    _, recording = laid
    thinner = drawn_in(recording, 0.002)
    rings = thinner.motion.collider[0].reshape(20, 200, 3)[1:-1]
    np.testing.assert_allclose(np.hypot(rings[..., 0], rings[..., 1]), RADIUS - 0.002, atol=2e-5)


def test_the_speed_of_the_body(laid):
    _, recording = laid
    shifted = recording.motion.collider + np.arange(6)[:, None, None] / FPS * np.array([0.4, 0, 0])
    moving = Recording(recording.collider, Motion(shifted, recording.motion.boundary), recording.observed, recording.noise)
    assert body_speed([moving], FPS) == pytest.approx(0.4)
    assert body_speed([recording, moving], FPS) == pytest.approx(0.4 / np.sqrt(2))
    assert (
        body_speed([Recording(NO_COLLIDER, Motion(np.zeros((6, 0, 3)), moving.motion.boundary), moving.observed, moving.noise)], FPS) == 0.0
    )
