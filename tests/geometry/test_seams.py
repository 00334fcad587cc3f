"""A tube whose texture is cut along one side: its vertices are doubled there and nowhere else."""

import numpy as np

from tasks.geometry.seams import cut_seams
from tests.export.avatars import tube


def test_seams_are_cut_where_texture_splits_and_nowhere_else():
    surface = tube()
    corners = cut_seams(surface.faces, surface.uv_faces)
    assert len(corners.vertex) == len(surface.vertices) + 9  # nine rows, each with one vertex on the seam
    assert np.array_equal(corners.vertex[corners.faces], surface.faces)
    assert np.array_equal(corners.uv[corners.faces], surface.uv_faces)
