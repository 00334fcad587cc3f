"""The pixel model against its own slow matrix, written out texel by texel."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.appearance.atlas import chart_of_texels, sample
from tasks.appearance.pixels import DEEP_SHADOW, REACH, NormalEquations, View, draw, sees_only, shade
from tasks.geometry.rasterise import rasterise
from tests.appearance.stage_figure import blotches, dressed_scene

SIZE = (24, 24)


def lit_view(*, size=40, camera=1, texture_size=SIZE):
    scene = dressed_scene(frames=1, cameras=4, size=size)
    A = np.random.default_rng(0).uniform(0.4, 1, size=(2 * scene.vertices.shape[1], 3)).astype(np.float32)
    return scene, A, scene.view(0, camera, A, texture_size)


def matrix_obvious(view, size, channel):
    """M [pixel, texel]: the image of every single texel, one at a time."""
    columns = []
    for k in range(size[0] * size[1]):
        texture = np.zeros((*size, 3), np.float32)
        texture.reshape(-1, 3)[k] = 1
        columns.append(shade(view, texture)[0][..., channel].ravel())
    return np.stack(columns, 1).astype(float)


def test_a_pixel_is_the_mean_of_four_look_ups_times_irradiance():
    """Every fully covered pixel again from scratch: hit points, irradiance and UV interpolated by hand."""
    scene, A, view = lit_view()
    texture = blotches(SIZE[0])
    image, covered = shade(view, texture)
    K = scene.cameras.K[1] * np.array([[2.0], [2], [1]])
    drawn = rasterise(K, scene.cameras.R[1], scene.cameras.t[1], (80, 80), scene.vertices[0], scene.faces)
    centre = scene.cameras.centres()[1]
    for i, j in np.argwhere(covered == 1)[::23]:
        total = np.zeros(3)
        for y, x in ((2 * i, 2 * j), (2 * i, 2 * j + 1), (2 * i + 1, 2 * j), (2 * i + 1, 2 * j + 1)):
            f, b = drawn.face[y, x], drawn.barycentric[y, x]
            p0, p1, p2 = scene.vertices[0][scene.faces[f]]
            behind = np.cross(p1 - p0, p2 - p0) @ (centre - p0) < 0
            light = b @ A[scene.faces[f] + behind * scene.vertices.shape[1]]
            total += light * sample(texture, b @ scene.uv_vertices[scene.uv_faces[f]]) / 4
        np.testing.assert_allclose(image[i, j], total, atol=2e-6)


def test_both_sides_of_the_skirt_are_lit_by_their_own_nodes():
    scene, A, _ = lit_view()
    sides = np.concatenate([np.full_like(A[: len(A) // 2], 0.25), np.full_like(A[: len(A) // 2], 0.75)])
    white = np.ones((*SIZE, 3), np.float32)
    image, covered = shade(scene.view(0, 0, sides, SIZE), white)
    assert np.median(image[covered == 1]) == 0.25
    up = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])  # lying under the hem
    below = replace(scene.cameras, R=np.tile(up, (4, 1, 1)), t=np.tile(-up @ [0.25, 0.3, 0], (4, 1)))
    view = draw(below, 0, scene.vertices[0], scene.faces, sides, scene.uv_vertices[scene.uv_faces], SIZE)
    image, covered = shade(view, white)
    assert np.median(image[covered == 1]) == 0.75


def test_the_stencil_is_the_normal_matrix():
    channel = 2
    _, _, view = lit_view()
    equations = NormalEquations(SIZE)
    image = np.random.default_rng(1).random((40, 40, 3)).astype(np.float32)
    covered = shade(view, np.ones((*SIZE, 3), np.float32))[1]
    usable = covered > 0
    equations.add(view, image, usable)
    M = matrix_obvious(view, SIZE, channel)
    reach = [span(row.reshape(SIZE)) <= REACH for row in M]
    M = M[np.array(reach) & (covered == 1).ravel()]
    assert equations.used == len(M)
    assert equations.left_out == usable.sum() - len(M) > 0
    ρ = np.random.default_rng(2).random((*SIZE, 3)).astype(np.float32)
    np.testing.assert_allclose(equations.times(ρ)[..., channel].ravel(), M.T @ (M @ ρ[..., channel].ravel()), atol=1e-5)
    y = image[..., channel].ravel()[np.array(reach) & (covered == 1).ravel()]
    np.testing.assert_allclose(equations.Mty[..., channel].ravel(), M.T @ y, atol=1e-5)
    np.testing.assert_allclose(equations.diagonal()[..., channel].ravel(), (M**2).sum(0), atol=1e-5)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("far", "used"), [(REACH, 1), (REACH + 1, 0)])
def test_a_pixel_counts_when_its_texels_lie_within_reach(axis, far, used):
    """One pixel of four sub-samples, between texel 5 and the last of texel 5 + far along one axis."""
    texel = np.full((2, 2, 2), 5.25, np.float32)
    texel[1, 1, axis] = 4.25 + far
    equations = NormalEquations((16, 16))
    view = View(np.zeros((2, 2), np.int32), texel, np.ones((2, 2, 3), np.float32))
    equations.add(view, np.ones((1, 1, 3), np.float32), np.ones((1, 1), bool))
    assert (equations.used, equations.left_out) == (used, 1 - used)
    np.testing.assert_allclose(equations.times(np.ones((16, 16, 3), np.float32)).sum(), 3 * used, atol=1e-6)  # (M1)² = 1 per channel


@pytest.mark.parametrize("at", [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_pixels_in_deep_shadow_are_not_fitted(at):
    for light, used in ((DEEP_SHADOW - 0.01, 0), (DEEP_SHADOW + 0.01, 1)):
        irradiance = np.ones((2, 2, 3), np.float32)
        irradiance[(*at, 2)] = light
        equations = NormalEquations((16, 16))
        equations.add(
            View(np.zeros((2, 2), np.int32), np.full((2, 2, 2), 5.25, np.float32), irradiance),
            np.ones((1, 1, 3), np.float32),
            np.ones((1, 1), bool),
        )
        assert (equations.used, equations.left_out) == (used, 0)


def span(row):
    """Farthest texels apart in a row of M, per axis; a look-up at a texel's very centre still reads its neighbour, with weight 0."""
    i, j = np.nonzero(row)
    return max(np.ptp(i), np.ptp(j)) if len(i) else 0


def test_the_laplacian_joins_texels_of_one_chart_only():
    scene = dressed_scene(frames=1)
    chart = chart_of_texels(scene.uv_vertices, scene.uv_faces, (64, 64))
    equations = NormalEquations((64, 64))
    equations.add_laplacian(chart, 0.3)
    each_chart_its_own_grey = np.repeat((1.0 + chart)[..., None], 3, -1).astype(np.float32)
    np.testing.assert_allclose(equations.times(each_chart_its_own_grey), 0, atol=1e-6)
    ρ = np.random.default_rng(3).random((64, 64, 3)).astype(np.float32)
    down = (chart[1:] == chart[:-1]) & (chart[1:] >= 0)
    across = (chart[:, 1:] == chart[:, :-1]) & (chart[:, 1:] >= 0)
    energy = ((ρ[1:] - ρ[:-1])[down] ** 2).sum() + ((ρ[:, 1:] - ρ[:, :-1])[across] ** 2).sum()
    np.testing.assert_allclose((ρ * equations.times(ρ)).sum(), 0.3 * energy, rtol=1e-4)


def test_texels_of_no_chart_do_not_wrap_from_one_row_to_the_next():
    """Negative control: a single lit texel at the end of a row leaves the start of the next row dark."""
    equations = NormalEquations((8, 8))
    equations.add_laplacian(np.zeros((8, 8), np.int32), 1.0)
    ρ = np.zeros((8, 8, 3), np.float32)
    ρ[3, 7] = 1
    out = equations.times(ρ)[..., 0]
    assert out[3, 7] == 3  # three neighbours
    assert out[2, 7] == out[4, 7] == out[3, 6] == -1
    assert np.abs(out).sum() == 6


def test_pixels_that_touch_a_forbidden_texel_are_told():
    _, _, view = lit_view()
    allowed = np.ones(SIZE, bool)
    assert sees_only(view, allowed).sum() == (shade(view, np.ones((*SIZE, 3), np.float32))[1] == 1).sum()
    allowed[8:16, 3:8] = False
    M = matrix_obvious(view, SIZE, 0)
    touched = (M[:, ~allowed.ravel()] > 0).any(1).reshape(40, 40)
    assert touched.any()
    assert not (sees_only(view, allowed) & touched).any()
