"""Twins: what their definition alone must not do to a fit."""

import numpy as np
import pytest

from tests.cloth.twins import resampled, skirt


def test_the_coarse_vertices_lie_where_the_cloth_is_and_not_on_its_chords():
    """On a cone both meshes have their vertices on the circle; the chords of 38 lie up to r(1 − cos(π/38)) = 0.7 mm inside."""
    fine, coarse = (19, 38), (14, 28)
    found = resampled(skirt(*fine)[0][None], fine, coarse)[0]
    assert found == pytest.approx(skirt(*coarse)[0], abs=2e-5)


def test_a_smooth_fold_keeps_its_depth():
    """Waves of a wavelength of nine fine edges: linear interpolation would lose up to (2π/9)²/8 = 6 % of them, at some vertices only."""
    fine, coarse = (19, 36), (14, 28)

    def wave(around):
        return np.cos(4 * 2 * np.pi * np.arange(around) / around)

    x = np.zeros((1, 19, 36, 3))
    x[..., 1] = wave(36)
    assert resampled(x.reshape(1, -1, 3), fine, coarse)[0, :, 1] == pytest.approx(np.tile(wave(28), 14), abs=5e-3)
