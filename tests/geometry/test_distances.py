"""Closest points of a surface that is none."""

import numpy as np
import pytest

from tasks.geometry.distances import closest_points
from tasks.geometry.faults import BadInput


def test_a_surface_without_faces_is_refused():
    with pytest.raises(BadInput, match="surface: it has no face"):
        closest_points(np.zeros((2, 3)), np.eye(3), np.zeros((0, 3), np.int32))
