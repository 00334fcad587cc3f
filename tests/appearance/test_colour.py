"""The sRGB curve at values one can look up, and both ways."""

import numpy as np

from tasks.appearance.colour import linear_from_srgb, srgb8_from_linear, srgb_from_linear


def test_known_values():
    """Mid grey: code 128 is 21.6 % of the light; linear ½ is code 188 (IEC 61966-2-1)."""
    np.testing.assert_allclose(linear_from_srgb(np.array([0, 128, 255], np.uint8)), [0, 0.2158605, 1], atol=1e-6)
    assert srgb8_from_linear(np.array(0.5)) == 188
    np.testing.assert_allclose(srgb_from_linear(np.array([0.0031308])), 12.92 * 0.0031308)


def test_every_code_comes_back():
    codes = np.arange(256, dtype=np.uint8)
    np.testing.assert_array_equal(srgb8_from_linear(linear_from_srgb(codes)), codes)
    assert (srgb8_from_linear(linear_from_srgb(codes) * 1.05)[20:240] > codes[20:240]).any()


def test_light_outside_the_display_is_clipped():
    np.testing.assert_array_equal(srgb8_from_linear(np.array([-0.1, 1.7])), [0, 255])
