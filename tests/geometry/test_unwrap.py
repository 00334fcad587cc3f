"""The automatic atlas: a valid, even, repeatable map, with the gutters that textures ask for."""

import numpy as np
from scipy.ndimage import distance_transform_edt

from tasks.appearance.atlas import chart_of_texels, texel_surface, uv_faults
from tasks.geometry.meshes import components, face_areas
from tasks.geometry.unwrap import unwrap
from tests.appearance.stage_figure import dressed, strip


def test_the_map_is_valid_and_faces_keep_their_order():
    vertices, faces, _, _ = dressed(fineness=2)
    uv_vertices, uv_faces = unwrap(vertices, faces, texture_size=256)
    assert uv_faults(uv_vertices, uv_faces, len(faces)) == []
    owners = [np.unique(faces[uv_faces == u]) for u in range(len(uv_vertices))]
    assert all(len(owner) == 1 for owner in owners)  # every uv vertex belongs to one vertex of the mesh


def test_texel_density_is_even():
    vertices, faces, _, _ = dressed(fineness=2)
    uv_vertices, uv_faces = unwrap(vertices, faces)
    density = face_areas(np.column_stack([uv_vertices, np.zeros(len(uv_vertices))]), uv_faces) / face_areas(vertices, faces)
    low, middle, high = np.quantile(density, [0.05, 0.5, 0.95])
    assert high < 1.6 * low
    assert 0.25 < (middle * face_areas(vertices, faces).sum()) < 1  # share of the texture in use


def test_charts_do_not_overlap_and_gutters_have_room():
    vertices, faces, _, _ = dressed(fineness=2)
    uv_vertices, uv_faces = unwrap(vertices, faces, texture_size=256)
    area = face_areas(np.column_stack([256 * uv_vertices, np.zeros(len(uv_vertices))]), uv_faces).sum()
    covered = (texel_surface(uv_vertices, uv_faces, (256, 256))[0] >= 0).sum()
    np.testing.assert_allclose(covered, area, rtol=0.02)  # overlapping charts would cover less than they measure
    chart = chart_of_texels(uv_vertices, uv_faces, (256, 256))
    assert len(np.unique(chart)) - 1 == len(np.unique(components(uv_faces, len(uv_vertices))))


def test_uv_triangles_keep_their_shape():
    """Ratio of the singular values of the map from surface to texture, triangle by triangle."""
    x, y = np.meshgrid(np.linspace(0, 0.1, 3), np.linspace(1, 0, 21))  # a ribbon: packed into a sheet far from square
    vertices, faces = np.stack([x, y, 0 * x], -1).reshape(-1, 3), strip(2, 21, closed=False)
    uv_vertices, uv_faces = unwrap(vertices, faces)
    edge = np.diff(vertices[faces], axis=1)  # [face, 2, 3]
    length = np.linalg.norm(edge[:, 0], axis=1)
    along = np.einsum("fc,fc->f", edge[:, 0], edge[:, 1]) / length
    across = np.sqrt(np.maximum((edge[:, 1] ** 2).sum(1) - along**2, 1e-12))
    flat = np.stack([np.stack([length, 0 * length], 1), np.stack([along, across], 1)], 1)
    s = np.linalg.svd(np.linalg.solve(flat, np.diff(uv_vertices[uv_faces], axis=1)), compute_uv=False)
    assert np.median(s[:, 0] / s[:, 1]) < 1.1


def test_charts_keep_two_gutters_apart():
    vertices, faces, _, _ = dressed(fineness=2)
    uv_vertices, uv_faces = unwrap(vertices, faces, texture_size=256)
    face, _ = texel_surface(uv_vertices, uv_faces, (256, 256))
    chart = np.where(face >= 0, components(uv_faces, len(uv_vertices))[uv_faces[face][..., 0]], -1)
    for label in np.unique(chart[chart >= 0]):
        assert distance_transform_edt(chart != label)[(chart >= 0) & (chart != label)].min() > 4


def test_the_same_mesh_gives_the_same_map():
    vertices, faces, _, _ = dressed()
    for a, b in zip(unwrap(vertices, faces), unwrap(vertices, faces), strict=True):
        np.testing.assert_array_equal(a, b)
