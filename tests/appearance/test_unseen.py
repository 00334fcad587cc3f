"""Filling over the surface: exact where it must be, across charts, never touching what was seen."""

import numpy as np

from tasks.appearance.unseen import fill_unseen
from tests.appearance.stage_figure import blotches, strip

SIZE = (64, 64)


def two_charts(columns=8, rows=8):
    """A flat sheet in the unit square of the plane, cut in the middle into two charts far apart in the texture."""
    x, y = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(1, 0, rows + 1))
    vertices = np.stack([x, y, 0 * x], -1).reshape(-1, 3)
    faces = strip(columns, rows + 1, closed=False)
    left = vertices[faces][:, :, 0].mean(1) < 0.5
    uv = np.concatenate([vertices[:, :2] * [0.8, 0.9] + [0.04, 0.05], vertices[:, :2] * [0.8, 0.9] + [0.16, 0.05]])
    return vertices, faces, uv, np.where(left[:, None], faces, faces + len(vertices)).astype(np.int32)


def painted(vertices, faces, uv, uv_faces, colour):
    """Texture and coverage of a colour given as a function of position."""
    from tasks.appearance.atlas import texel_surface

    face, b = texel_surface(uv, uv_faces, SIZE)
    x = np.einsum("ijk,ijkc->ijc", b, vertices[faces[face]])
    return np.where((face >= 0)[..., None], colour(x), 0).astype(np.float32), face >= 0, x


def test_what_was_seen_is_kept_to_the_bit():
    vertices, faces, uv, uv_faces = two_charts()
    observed = np.random.default_rng(0).random(SIZE) < 0.4
    texture = blotches(64)
    np.testing.assert_array_equal(fill_unseen(texture, observed, faces, uv, uv_faces, len(vertices))[observed], texture[observed])


def test_a_linear_colour_seen_on_both_sides_continues_between_them_across_the_seam():
    """Linear functions are harmonic, also for the plain graph Laplacian of a regular grid; the seam lies in the unseen middle."""
    vertices, faces, uv, uv_faces = two_charts()
    texture, covered, x = painted(vertices, faces, uv, uv_faces, lambda x: 0.2 + 0.6 * x[..., :1].repeat(3, -1))
    observed = covered & ((x[..., 0] < 0.3) | (x[..., 0] > 0.7))
    spoilt = np.where(observed[..., None], texture, 0)
    filled = fill_unseen(spoilt, observed, faces, uv, uv_faces, len(vertices))
    inner = covered & (x[..., 1] > 0.1) & (x[..., 1] < 0.9)
    np.testing.assert_allclose(filled[inner], texture[inner], atol=0.06)  # vertex means at the rim sit most of a face, 0.075, off
    middle = inner & (np.abs(x[..., 0] - 0.5) < 0.02)
    np.testing.assert_allclose(filled[middle].mean(), 0.5, atol=0.01)


def test_gutters_take_the_nearest_texel_of_the_surface():
    vertices, faces, uv, uv_faces = two_charts()
    texture, covered, _ = painted(vertices, faces, uv, uv_faces, lambda x: np.full((*x.shape[:2], 3), 0.7))
    np.testing.assert_allclose(fill_unseen(texture, covered, faces, uv, uv_faces, len(vertices)), 0.7, atol=1e-6)


def test_nothing_seen_at_all_gives_grey():
    vertices, faces, uv, uv_faces = two_charts()
    filled = fill_unseen(blotches(64), np.zeros(SIZE, bool), faces, uv, uv_faces, len(vertices))
    np.testing.assert_allclose(filled, 0.5, atol=1e-6)
