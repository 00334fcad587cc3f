"""Texel addressing by hand, and charts with their gutters."""

import numpy as np

from tasks.appearance.atlas import GUTTER, chart_of_texels, face_means, sample, texel_coordinates, texel_surface, uv_faults
from tests.appearance.stage_figure import dressed


def test_a_texel_is_read_at_its_centre_and_row_zero_is_the_top():
    texture = np.arange(12.0).reshape(3, 4, 1)
    uv = np.array([[0.5 / 4, 1 - 0.5 / 3], [3.5 / 4, 0.5 / 3], [1.0 / 4, 1 - 0.5 / 3]])
    np.testing.assert_allclose(sample(texture, uv)[:, 0], [0, 11, 0.5])


def test_a_linear_texture_is_read_linearly_and_clamped_outside():
    i, j = np.meshgrid(np.arange(8), np.arange(8), indexing="ij")
    texture = (0.3 * i + 0.7 * j)[..., None]
    uv = np.random.default_rng(0).uniform(1 / 16, 15 / 16, size=(50, 2))
    x = texel_coordinates(uv, (8, 8))
    np.testing.assert_allclose(sample(texture, uv)[:, 0], 0.7 * x[:, 0] + 0.3 * x[:, 1], atol=1e-12)
    np.testing.assert_allclose(sample(texture, np.array([[0.0, 1.0]])), [[0.0]])


def test_face_means_of_a_linear_texture_are_its_value_at_the_centroid():
    i, j = np.meshgrid(np.arange(64), np.arange(64), indexing="ij")
    texture = (0.3 * i + 0.7 * j)[..., None]
    uv = np.array([[0.1, 0.2], [0.9, 0.3], [0.4, 0.8]])
    mean = face_means(texture, uv, np.array([[0, 1, 2]]))
    np.testing.assert_allclose(mean, sample(texture, uv.mean(0)[None]), atol=1e-9)


def test_every_bilinear_look_up_stays_in_its_own_chart():
    _, _, uv_vertices, uv_faces = dressed()
    size = (64, 64)
    chart = chart_of_texels(uv_vertices, uv_faces, size)
    assert set(np.unique(chart)) == {-1, 0, 1}
    rng = np.random.default_rng(1)
    faces = rng.integers(len(uv_faces), size=4000)
    uv = np.einsum("nk,nkc->nc", rng.dirichlet([0.3] * 3, size=4000), uv_vertices[uv_faces[faces]])
    column, row = np.moveaxis(np.floor(texel_coordinates(uv, size)).astype(int), -1, 0)
    own = chart[np.clip(row, 0, 63), np.clip(column, 0, 63)]
    for down, across in ((0, 1), (1, 0), (1, 1)):
        np.testing.assert_array_equal(chart[row + down, column + across], own)
    assert (own >= 0).all()
    covered = texel_surface(uv_vertices, uv_faces, size)[0] >= 0
    assert ((chart >= 0) & ~covered).sum() > 4 * GUTTER * 40  # gutters exist


def test_texel_surface_points_back_at_the_texel():
    _, _, uv_vertices, uv_faces = dressed()
    face, barycentric = texel_surface(uv_vertices, uv_faces, (40, 50))
    row, column = np.nonzero(face >= 0)
    uv = np.einsum("nk,nkc->nc", barycentric[row, column], uv_vertices[uv_faces[face[row, column]]])
    np.testing.assert_allclose(texel_coordinates(uv, (40, 50)), np.stack([column, row], 1), atol=1e-4)


def test_tiled_or_missing_uv_is_refused():
    faults = uv_faults(np.array([[0.0, 0], [2, 0], [0, 1]]), np.array([[0, 1, 2]]), 7)
    assert [fault.where for fault in faults] == ["uv_faces", "uv_vertices"]
    (fault,) = uv_faults(np.zeros((0, 2)), np.zeros((0, 3), np.int32), 7)
    assert "there are none" in str(fault)
