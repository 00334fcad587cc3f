"""Noise on a border that rides with the body goes; a border that breathes keeps breathing; the rest is left alone."""

import numpy as np

from tasks.cloth.driven_motion import WornRest, _poses, quieted
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


def still_shape(truth: np.ndarray) -> np.ndarray:
    """What noise made of the mean shape: the part of an error that stays in the ring's own frame, root mean square over frames."""
    rest = ring(1)[0] - ring(1)[0].mean(0)
    centre, R = _poses(truth, rest)
    return np.einsum("tji,tbj->tbi", R, truth - centre[:, None]).mean(0) - rest


def test_a_shape_known_at_rest_keeps_no_wrinkles_of_noise():
    truth, rest = ring(), 2.0 + ring(1)[0] @ matrix_from_axis_angle(np.array([0.3, 1.0, 0.2]))
    noisy = truth + np.random.default_rng(4).normal(scale=1e-3, size=truth.shape)
    with_rest, without = (rms_mm(still_shape(quieted(noisy, 1e-3, r))) for r in (rest, None))
    assert without > 0.15 and with_rest < 0.3 * without


def test_a_shape_that_is_not_the_one_at_rest_stays():
    truth = ring()
    noisy = truth + np.random.default_rng(5).normal(scale=1e-3, size=truth.shape)
    elsewhere = ring(1)[0] * (1.05, 1.0, 0.95)
    first = noisy[0]  # a rest shape that is no better known than one frame
    for rest in (elsewhere, first):
        assert rms_mm(quieted(noisy, 1e-3, rest) - truth) < 1.1 * rms_mm(quieted(noisy, 1e-3) - truth)


def test_poses_do_not_jitter():
    """Each pose averages its frame alone: what is left of a rigid ring's noise jumps from frame to frame unless it is smoothed in time."""
    truth = ring()
    noisy = truth + np.random.default_rng(0).normal(scale=1e-3, size=truth.shape)
    single = 1e-3 * np.sqrt(2 / truth.shape[1])  # of a pose, per coordinate
    found = quieted(noisy, 1e-3) - truth
    assert np.sqrt(np.mean(acceleration(found) ** 2)) < 0.8 * np.sqrt(6) * 25**2 * single


def test_a_jolt_is_not_smoothed_away():
    truth = ring()
    truth[12:] += (0.02, 0, 0)
    noisy = truth + np.random.default_rng(3).normal(scale=1e-3, size=truth.shape)
    assert rms_mm(quieted(noisy, 1e-3) - truth) < 0.45


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


def lengths(x: np.ndarray) -> np.ndarray:
    """Of the chords from node to node [..., B]."""
    return np.linalg.norm(np.diff(x, axis=-2), axis=-1)


def test_a_border_that_begins_at_rest_is_not_strained_for_its_noise_however_it_turns():
    """By 40 degrees: left as it lay in the first frame, the noise strains the ring by 2 % root mean square, quieted alone by 3."""
    x = ring() + np.random.default_rng(0).normal(scale=1e-3, size=ring().shape)
    quiet = quieted(x, 1e-3, x[0])
    kept = WornRest(x[0], quiet[0]).kept(quiet)
    strain = [float(np.sqrt(np.mean((lengths(y) / lengths(x[0]) - 1) ** 2))) for y in (quiet, quiet + (x[0] - quiet[0]), kept)]
    assert strain[0] > 0.03 and strain[1] > 0.015 and strain[2] < 1e-3
    np.testing.assert_allclose(kept[0], x[0], atol=1e-12)


def test_the_noise_of_a_straight_border_is_not_turned_about_it():
    """Nothing but noise says how a straight border is turned about itself."""
    straight = np.linspace(0, 0.2, 9)[None, :, None] * [1.0, 0, 0] + 0.1 * np.sin(np.arange(24))[:, None, None] * [0, 0, 1.0]
    x = straight + np.random.default_rng(0).normal(scale=1e-3, size=straight.shape)
    quiet = quieted(x, 1e-3)
    kept = WornRest(x[0], quiet[0]).kept(quiet)
    np.testing.assert_allclose(kept - quiet, np.broadcast_to(x[0] - quiet[0], x.shape), atol=2e-4)
