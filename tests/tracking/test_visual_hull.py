"""The hull of simple solids: closed, outward, of the right size, with well-shaped triangles."""

import numpy as np
import pytest

from tasks.geometry.faults import BadInput
from tasks.geometry.meshes import boundary_edges, face_areas, mesh_faults
from tasks.geometry.rasterise import rasterise
from tasks.tracking.visual_hull import visual_hull
from tests.tracking.skirt import ring


@pytest.fixture(scope="module")
def ball():
    """Masks of a ball of radius 0.35 m around (0, 0.5, 0), seen from 12 sides, two of them portrait with a shifted principal point."""
    import igl

    octahedron = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1.0]])
    V, F = igl.upsample(octahedron, np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]), 5)
    x = [0, 0.5, 0] + 0.35 * V / np.linalg.norm(V, axis=1, keepdims=True)
    cameras = ring(12, 160, height=0.6)
    return [rasterise(cameras.K[k], cameras.R[k], cameras.t[k], cameras.size[k], x, F).face >= 0 for k in range(12)], cameras


@pytest.fixture(scope="module")
def hull(ball):
    return visual_hull(*ball, target_vertices=1500, voxel=0.02)


def test_it_is_closed_and_manifold_and_has_the_size_asked_for(hull):
    vertices, faces = hull
    assert not len(boundary_edges(faces)) and not mesh_faults(vertices, faces, "hull")
    assert abs(len(vertices) - 1500) < 15
    assert len(vertices) - len(faces) / 2 == 2  # Euler: a sphere


def test_the_hull_of_a_ball_holds_the_ball_and_little_more(hull):
    """Where outlines constrain it (the flanks) the radius is right;
    above and below, where no camera looks along the surface, it is a cap.
    """
    vertices, faces = hull
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = np.einsum("fi,fi->", a, np.cross(b, c)) / 6
    assert 1.0 < volume / (4 / 3 * np.pi * 0.35**3) < 1.12
    flank = np.abs(vertices[:, 1] - 0.5) < 0.1
    radius = np.linalg.norm(vertices[flank] - [0, 0.5, 0], axis=1)
    assert abs(np.median(radius) - 0.35) < 0.006 and radius.min() > 0.335


def test_triangles_are_well_shaped(hull):
    """Quality 4√3 A/Σl², 1 for equilateral."""
    vertices, faces = hull
    sides = sum(((vertices[faces[:, k]] - vertices[faces[:, k - 1]]) ** 2).sum(1) for k in range(3))
    quality = 4 * np.sqrt(3) * face_areas(vertices, faces) / sides
    assert quality.mean() > 0.85 and np.percentile(quality, 1) > 0.4


def test_masks_of_another_rig_are_refused(ball):
    masks, cameras = ball
    empty = [np.zeros_like(m) for m in masks]
    with pytest.raises(BadInput, match="no point lies within all"):
        visual_hull(empty, cameras)
    with pytest.raises(BadInput, match="calibrated size"):
        visual_hull([m[:-1] for m in masks], cameras)
