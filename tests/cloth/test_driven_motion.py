"""Noise on a border that rides with the body goes; a border that breathes keeps breathing; the rest is left alone."""

import numpy as np

from tasks.cloth.driven_motion import quieted
from tasks.geometry.rotations import matrix_from_axis_angle


def ring(T: int = 24, B: int = 40, *, breathing: float = 0.0) -> np.ndarray:
    a, t = np.arange(B) * 2 * np.pi / B, np.arange(T) / 25
    x = 0.14 * np.stack([np.cos(a), 0.2 * np.sin(2 * a), np.sin(a)], 1)
    swell = breathing * np.sin(2 * np.pi * 0.8 * t)[:, None, None] * np.stack([np.cos(2 * a), 0 * a, np.sin(3 * a)], 1)
    R = matrix_from_axis_angle(np.stack([0.2 * np.sin(5 * t), 0.7 * np.sin(8 * t), 0 * t], 1))
    return np.einsum("tij,tbj->tbi", R, x + swell) + np.stack([0.1 * np.sin(7 * t), 0 * t, t], 1)[:, None]


def rms_mm(d: np.ndarray) -> float:
    return 1e3 * float(np.sqrt(np.mean(d**2)))


def acceleration(x: np.ndarray) -> np.ndarray:
    return np.diff(x, 2, axis=0) * 25**2


def test_the_noise_of_a_rigid_border_is_averaged_away():
    truth = ring()
    noisy = truth + np.random.default_rng(0).normal(scale=1e-3, size=truth.shape)
    found = quieted(noisy, 1e-3)
    assert rms_mm(found - truth) < 0.35  # 1 mm went in; what stays is the mean shape's, σ/√T, and the pose's, σ/√B
    assert rms_mm(acceleration(found - truth)) < 0.35 * rms_mm(acceleration(noisy - truth))


def test_a_border_that_breathes_keeps_its_motion():
    truth = ring(breathing=0.01)
    noisy = truth + np.random.default_rng(1).normal(scale=1e-3, size=truth.shape)
    assert rms_mm(quieted(noisy, 1e-3) - truth) < 0.5
    assert rms_mm(ring() - truth) > 3  # what a rigid ring would have made of it


def test_without_noise_nothing_is_done():
    truth = ring(breathing=0.01)
    np.testing.assert_array_equal(quieted(truth, 0.0), truth)
    assert rms_mm(quieted(truth, 1e-7) - truth) < 1e-3
    few = truth[:, :3]
    np.testing.assert_array_equal(quieted(few, 1e-3), few)
