"""The automatic atlas: a valid, even, repeatable map."""

import numpy as np

from tasks.appearance.atlas import chart_of_texels, texel_surface, uv_faults
from tasks.appearance.unwrap import unwrap
from tasks.geometry.meshes import components, face_areas
from tests.appearance.stage_figure import dressed


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


def test_the_same_mesh_gives_the_same_map():
    vertices, faces, _, _ = dressed()
    for a, b in zip(unwrap(vertices, faces), unwrap(vertices, faces), strict=True):
        np.testing.assert_array_equal(a, b)
