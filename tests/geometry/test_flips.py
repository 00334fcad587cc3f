"""Other diagonals: the same surface, other triangles, none much worse."""

import numpy as np
import pytest

from tasks.geometry.flips import LONGER, flip
from tasks.geometry.meshes import edges, face_areas, face_normals, mesh_faults
from tests.geometry.test_refinement import wild
from tests.simulator.scenes import sheet, sphere

MESHES = {"sheet": sheet(6, 5), "sphere": sphere(3, 1.0), "wild": wild(200)}


@pytest.mark.parametrize("name", MESHES)
def test_it_is_the_same_surface_in_other_triangles(name):
    x, faces = MESHES[name]
    found, _ = flip(x, faces)
    assert not mesh_faults(x, found, "flipped", metres=False)
    assert face_areas(x, found).sum() == pytest.approx(face_areas(x, faces).sum(), rel=2e-3)
    changed = (found != faces).any(1)
    assert changed.mean() > 0.5 and len(edges(found)) == len(edges(faces))
    assert (np.sum(face_normals(x, found) * face_normals(x, faces), 1) > 0.9).all()
    long = [np.linalg.norm(x[e[:, 0]] - x[e[:, 1]], axis=1).max() for e in (edges(found), edges(faces))]
    assert long[0] < LONGER * long[1]


def test_a_grid_gets_its_other_diagonals():
    x, faces = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1]], float), np.array([[0, 2, 1], [1, 2, 3]], np.int32)
    found, _ = flip(x, faces)
    assert {frozenset(f) for f in found.tolist()} == {frozenset((0, 2, 3)), frozenset((0, 3, 1))}


def test_corners_keep_their_values_and_seams_stay():
    x, faces = MESHES["sheet"]
    found, uv = flip(x, faces, x[faces][..., [0, 2]])
    np.testing.assert_array_equal(uv, x[found][..., [0, 2]])
    apart = x[faces][..., [0, 2]] + np.arange(len(faces))[:, None, None]  # every edge is a seam
    assert np.array_equal(flip(x, faces, apart)[0], faces)


def test_a_pair_that_is_bent_or_not_convex_keeps_its_diagonal():
    faces = np.array([[0, 1, 2], [1, 0, 3]], np.int32)
    flat = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -1, 0]], float)
    assert not np.array_equal(flip(0.0 + flat * [2.0, 1.0, 1.0], faces)[0], faces)
    bent, dart = flat.copy() * [2.0, 1.0, 1.0], flat * [2.0, 1.0, 1.0]
    bent[3] = [1.0, 0.0, 1.0]
    dart[3, 0] = -1.5
    assert np.array_equal(flip(bent, faces)[0], faces)
    assert np.array_equal(flip(dart, faces)[0], faces)


def test_a_diagonal_that_does_not_cross_in_the_pattern_stays():
    """Worn cloth is shaped otherwise than its pattern: a pair that is convex on the body may be a dart on the table."""
    worn = np.array([[0, 0, 0], [2, 0, 0], [1, 1, 0], [1, -1, 0]], float)
    faces = np.array([[0, 1, 2], [1, 0, 3]], np.int32)
    table = worn[:, :2].copy()
    assert not np.array_equal(flip(worn, faces, table[faces])[0], faces)
    table[3] = [-1.5, -1.0]
    found, places = flip(worn, faces, table[faces])
    np.testing.assert_array_equal(found, faces)
    np.testing.assert_array_equal(places, table[faces])
