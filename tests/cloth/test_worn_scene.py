"""A garment of the pipeline as a scene: driven nodes without the first frame's noise where a pattern is the rest shape."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth.garment import Garment
from tasks.cloth.worn_scene import worn_scene
from tests.cloth.test_boundary import swing

NOISE = 7e-4


@pytest.fixture(scope="module")
def tracked():
    """The motion without noise, the garment with it, its body, and an atlas of single faces cut flat."""
    x, faces, body, body_faces = swing()
    y = x + NOISE * np.random.default_rng(1).standard_normal(x.shape)
    a, b = x[0][faces[:, 1]] - x[0][faces[:, 0]], x[0][faces[:, 2]] - x[0][faces[:, 0]]
    length = np.linalg.norm(a, axis=1)
    along = np.sum(a * b, 1) / length
    across = np.sqrt(np.sum(b * b, 1) - along**2)
    zero = np.zeros(len(faces))
    flat = np.stack([np.stack([zero, zero], 1), np.stack([length, zero], 1), np.stack([along, across], 1)], 1).reshape(-1, 2)
    uv_faces = np.arange(3 * len(faces), dtype=np.int32).reshape(-1, 3)
    seen = np.ones(y.shape[:2], bool)
    return x, Garment("skirt", np.arange(y.shape[1]), faces, y, seen, np.full(y.shape[:2], NOISE), uv_faces), body, body_faces, flat


def test_with_a_pattern_the_first_frames_noise_is_not_carried_along(tracked):
    x, garment, body, body_faces, flat = tracked
    scene = worn_scene(garment, body, body_faces, flat, fps=25.0)
    B = scene.cloth.boundary
    assert scene.cloth.rest_angles == "flat"
    np.testing.assert_array_equal(scene.x0[B], scene.boundary_motion[0])
    off, raw = (np.sqrt(np.mean((z - x[:, B]) ** 2)) for z in (scene.boundary_motion, garment.observed[:, B]))
    assert off < 0.6 * raw


def test_a_first_frame_that_is_the_rest_shape_keeps_its_noise(tracked):
    _, garment, body, body_faces, flat = tracked
    scene = worn_scene(garment, body, body_faces, flat, fps=25.0, rest="worn")
    np.testing.assert_allclose(scene.x0, garment.observed[0], atol=1e-12)
    np.testing.assert_array_equal(scene.x0[scene.cloth.boundary], scene.boundary_motion[0])


def test_what_is_said_of_the_noise_where_nothing_was_seen_does_not_count(tracked):
    """Two thirds are hidden, and said to be a metre off."""
    _, garment, body, body_faces, flat = tracked
    seen = np.zeros_like(garment.seen)
    seen[:, ::3] = True
    hidden = replace(garment, seen=seen, noise_m=np.where(seen, NOISE, 1.0))
    scene, bare = (worn_scene(g, body, body_faces, flat, fps=25.0) for g in (hidden, garment))
    np.testing.assert_allclose(scene.noise_m, NOISE)
    np.testing.assert_array_equal(scene.boundary_motion, bare.boundary_motion)
