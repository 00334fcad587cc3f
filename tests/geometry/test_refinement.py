"""Refined meshes: conforming, the same surface, the old vertices first."""

import numpy as np
import pytest

from tasks.geometry.meshes import boundary_edges, edges, face_areas, face_normals, mesh_faults
from tasks.geometry.refinement import refine
from tests.simulator.scenes import sheet, sphere


def wild(n: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """A flat triangulation of random points."""
    from scipy.spatial import Delaunay

    points = np.random.default_rng(4).uniform(size=(n, 2))
    faces = Delaunay(points).simplices
    a, b, c = (points[faces[:, k]] for k in range(3))
    turned = np.cross(b - a, c - a) < 0
    faces[turned] = faces[turned][:, ::-1]
    return np.column_stack([points, np.zeros(n)]), faces.astype(np.int32)


MESHES = {"sheet": sheet(6, 5), "sphere": sphere(2, 1.0), "wild": wild()}


@pytest.fixture(params=MESHES, ids=list(MESHES))
def mesh(request):
    x, faces = MESHES[request.param]
    step = refine(x, faces)
    return x, faces, step, step.field(x)


def test_the_surface_is_the_same(mesh):
    x, faces, step, y = mesh
    assert np.array_equal(y[: len(x)], x)
    np.testing.assert_allclose(np.bincount(step.parent_face, face_areas(y, step.faces), len(faces)), face_areas(x, faces), rtol=1e-12)
    np.testing.assert_allclose(face_normals(y, step.faces), face_normals(x, faces)[step.parent_face], atol=1e-9)


def test_neighbours_fit(mesh):
    x, faces, step, y = mesh
    assert not mesh_faults(y, step.faces, "refined", metres=False)
    assert len(np.unique(step.faces)) == len(y)
    assert _euler(y, step.faces) == _euler(x, faces)  # a vertex hanging on an edge would be a hole
    assert _border(y, step.faces) == pytest.approx(_border(x, faces))


def _euler(x: np.ndarray, faces: np.ndarray) -> int:
    return len(x) - len(edges(faces)) + len(faces)


def _border(x: np.ndarray, faces: np.ndarray) -> float:
    """Length of the open borders [m]."""
    a, b = boundary_edges(faces).T
    return float(np.linalg.norm(x[b] - x[a], axis=1).sum())


def test_the_vertices_about_double(mesh):
    x, _, _, y = mesh
    assert 1.5 < len(y) / len(x) < 2.6


def test_every_longest_edge_is_split_and_nothing_gets_thin(mesh):
    x, faces, step, y = mesh

    def longest(x, faces):
        return np.linalg.norm(x[faces] - x[np.roll(faces, -1, 1)], axis=2).max(1)

    def least_angle(x, faces):
        a, b = x[np.roll(faces, -1, 1)] - x[faces], x[np.roll(faces, -2, 1)] - x[faces]
        return np.arccos(np.sum(a * b, 2) / np.linalg.norm(a, axis=2) / np.linalg.norm(b, axis=2)).min()

    assert (longest(y, step.faces) <= longest(x, faces)[step.parent_face] * (1 + 1e-9)).all()
    assert np.bincount(step.parent_face, minlength=len(faces)).min() >= 2
    assert least_angle(y, step.faces) >= 0.5 * least_angle(x, faces) * (1 - 1e-9)


def test_corners_follow_a_linear_pattern(mesh):
    """A linear function of the place, given at the corners of each face, is that function at the new corners."""
    x, faces, step, y = mesh
    A = np.random.default_rng(1).normal(size=(3, 2))
    np.testing.assert_allclose(step.corners((x @ A)[faces]), (y @ A)[step.faces], atol=1e-12)


def test_corners_keep_cuts_in_the_pattern():
    """Each face with a pattern of its own: no child takes from the neighbour."""
    x, faces = sheet(4, 4)
    step = refine(x, faces)
    own = np.repeat(np.arange(len(faces), dtype=float), 3).reshape(-1, 3, 1)
    np.testing.assert_allclose(step.corners(own)[:, :, 0], step.parent_face[:, None] + np.zeros(3))


def test_fields_of_motions():
    x, faces = sheet(3, 3)
    step = refine(x, faces)
    path = np.stack([x, x + 1.0])
    assert step.field(path).shape == (2, len(x) + len(step.parents), 3)
    np.testing.assert_allclose(step.field(path)[1], step.field(x) + 1.0)
