"""Image levels: blur of the stated size at the stated place, look-up with exact derivatives, cameras of any size."""

import numpy as np
import pytest
from numba import njit

from tasks.geometry.cameras import Cameras, project
from tasks.tracking import pyramid
from tests.tracking.skirt import ring


@njit
def _read(pixels, offset, width, height, u, v):
    value, du, dv = np.empty(4), np.empty(4), np.empty(4)
    pyramid.look_up(pixels, offset, width, height, u, v, value, du, dv)
    return value, du, dv


def read(level, k, u, v):
    return _read(level.pixels, level.offset[k], level.size[k, 0], level.size[k, 1], u / level.scale, v / level.scale)


@pytest.mark.parametrize("blur", [1.0, 2.0, 4.0, 8.0])
def test_a_spot_stays_in_its_place_and_gains_variance_σ2(blur):
    x, y, spread = 70.3, 60.9, 4.0
    j, i = np.mgrid[:125, :141] + 0.5
    spot = np.exp(-((i - x) ** 2 + (j - y) ** 2) / (2 * spread**2))[..., None].repeat(4, 2).astype(np.float32)
    level = pyramid.level([spot], blur)
    grid = np.arange(0.5, 125, 1.0)
    p = np.array([[read(level, 0, u, v)[0][0] for u in grid] for v in grid])
    p /= p.sum()
    across, down = p.sum(0), p.sum(1)
    assert (across @ grid, down @ grid) == pytest.approx((x, y), abs=0.02)
    assert across @ (grid - x) ** 2 - spread**2 == pytest.approx(blur**2, rel=0.02)


def test_derivatives_are_those_of_the_value():
    rng = np.random.default_rng(0)
    level = pyramid.level([rng.uniform(0, 1, (h, w, 4)).astype(np.float32) for w, h in ((40, 30), (33, 47))], 1.0)
    for u, v in rng.uniform(2, 28, (20, 2)):
        _, du, dv = read(level, 1, u, v)
        assert du == pytest.approx((read(level, 1, u + 1e-5, v)[0] - read(level, 1, u - 1e-5, v)[0]) / 2e-5, abs=1e-7)
        assert dv == pytest.approx((read(level, 1, u, v + 1e-5)[0] - read(level, 1, u, v - 1e-5)[0]) / 2e-5, abs=1e-7)


def test_a_ramp_is_read_exactly():
    ramp = np.broadcast_to((np.arange(60) + 0.5).astype(np.float32)[None, :, None], (50, 60, 4)).copy()
    for blur in (1.0, 4.0):
        value, du, dv = read(pyramid.level([ramp], blur), 0, 31.3, 24.9)
        assert value == pytest.approx(31.3, abs=1e-4)
        assert np.abs(dv).max() < 1e-5 and du.min() > 0.5


def test_colour_is_premultiplied_by_the_mask():
    cameras = ring(1, 32)
    width, height = cameras.size[0]
    white, mask = np.full((height, width, 3), 255, np.uint8), np.zeros((height, width), bool)
    mask[:, :10] = True
    (four,) = pyramid.stack(lambda t, k: white, lambda t, k: mask, 0, cameras)
    assert np.array_equal(four[..., 0], mask) and np.array_equal(four[..., 3], mask)


def test_a_distorted_image_is_brought_to_the_pinhole_camera():
    straight = ring(1, 200)
    bent = Cameras(straight.names, straight.K, straight.R, straight.t, straight.size, np.array([[-0.25, 0.08, 0.002, -0.001, 0.0]]))
    x = np.array([0.3, 0.85, 0.05])
    (u, v), (u0, v0) = project(bent, x)[0][0], project(straight, x)[0][0]
    assert np.hypot(u - u0, v - v0) > 0.2  # else the test sees nothing
    j, i = np.mgrid[: bent.size[0, 1], : bent.size[0, 0]] + 0.5
    blob = np.exp(-((i - u) ** 2 + (j - v) ** 2) / 8)[..., None].repeat(3, 2)
    (four,) = pyramid.stack(lambda t, k: blob, None, 0, bent)
    p = four[..., 0] / four[..., 0].sum()
    assert ((p * i).sum(), (p * j).sum()) == pytest.approx((u0, v0), abs=0.02)
