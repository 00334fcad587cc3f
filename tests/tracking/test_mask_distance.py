"""Distances to the outline of a mask against SciPy's, which counts in whole numbers."""

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from tasks.tracking.mask_distance import signed_distance


@pytest.mark.parametrize("share", [0.02, 0.5, 0.98])
def test_it_is_the_distance_to_the_bit_whenever_it_is_asked(share):
    inside = np.random.default_rng(0).uniform(size=(50, 70)) < share
    expected = np.where(inside, distance_transform_edt(inside) - 0.5, 0.5 - distance_transform_edt(~inside)).astype(np.float32)
    for _ in range(20):
        assert np.array_equal(signed_distance(inside), expected)


def test_along_a_straight_edge_it_counts_pixels_from_their_border():
    inside = np.zeros((4, 6), bool)
    inside[:, :3] = True
    np.testing.assert_array_equal(signed_distance(inside), np.tile([2.5, 1.5, 0.5, -0.5, -1.5, -2.5], (4, 1)))
