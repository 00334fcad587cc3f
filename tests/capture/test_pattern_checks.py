"""Sewing patterns that are none: faces without area, folded faces, texture coordinates instead of metres."""

import numpy as np
import pytest

from tasks.capture.pattern_checks import pattern_faults
from tests.capture.test_tracked_geometry import square


def faults(uv, surface=None, faces=None):
    x, own = square(4)
    return [str(f) for f in pattern_faults(uv, own if faces is None else faces, x if surface is None else surface, "t.npz")]


@pytest.fixture
def uv():
    return square(4)[0][:, :2]


def test_a_pattern_may_be_mirrored_turned_and_somewhat_smaller_than_the_garment(uv):
    assert faults(uv) == []
    assert faults(uv[:, ::-1]) == []
    assert faults(0.8 * uv) == []


def test_a_piece_may_be_mirrored_against_another(uv):
    x, one = square(4)
    two = np.concatenate([one, one + len(x)])
    both = np.concatenate([uv, uv * [-1, 1]])
    assert faults(both, np.concatenate([x, x + 2.0]), two) == []


def test_a_face_without_area_and_one_that_is_flipped(uv):
    flat = uv.copy()
    flat[0] = (uv[1] + uv[5]) / 2
    (said,) = faults(flat)
    assert "1 faces have no area in the pattern, the first is face 0" in said and "t.npz: uv" in said
    folded = uv.copy()
    folded[0] = [0.6, 0.4]
    (said,) = faults(folded)
    assert "flipped" in said and "Unfold them" in said


@pytest.mark.parametrize("factor", [0.01, 10.0])
def test_texture_coordinates_are_not_metres(uv, factor):
    (said,) = faults(factor * uv)
    assert f"{factor:.3g} times as long" in said and "metres" in said
