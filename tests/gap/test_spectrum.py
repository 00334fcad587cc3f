"""The spectrum within windows, of motions put together by hand."""

import numpy as np
import pytest

from tasks.gap.spectrum import spectrum

FPS = 30.0


def test_an_offset_and_a_swing_are_found_in_their_bands_and_add_up():
    t = np.arange(6)[:, None, None] / FPS
    field = 0.003 * np.ones((6, 7, 3)) * (1, 0, 0) + 0.002 * np.sqrt(2) * np.sin(2 * np.pi * 10 * t) * (0, 1, 0)
    found = spectrum([field, field], FPS, 1e-3)
    np.testing.assert_allclose(found.frequency, [0, 5, 10, 15], atol=1e-9)
    np.testing.assert_allclose(found.rms_mm, [3, 0, 2, 0], atol=1e-9)
    assert np.sum(found.rms_mm**2) == pytest.approx(1e6 * np.mean(np.sum(field**2, -1)))


@pytest.mark.parametrize("length", [5, 6])
def test_white_noise_has_the_noise_spectrum(length):
    rng = np.random.default_rng(0)
    found = spectrum([1e-3 * rng.standard_normal((length, 300, 3)) for _ in range(20)], FPS, 1e-3)
    np.testing.assert_allclose(found.rms_mm, found.noise_mm, rtol=0.03)
    assert np.sum(found.noise_mm**2) == pytest.approx(3.0)


def test_vertices_with_gaps_and_windows_of_other_lengths_are_left_out():
    field = np.full((5, 4, 3), 0.001)
    field[2, 1] = np.nan
    found = spectrum([field, field, np.ones((6, 4, 3))], FPS, 1e-3)
    assert found.rms_mm[0] == pytest.approx(np.sqrt(3))


def test_too_short_windows_have_no_spectrum():
    assert spectrum([np.ones((3, 4, 3))], FPS, 1e-3) is None
    assert spectrum([], FPS, 1e-3) is None
