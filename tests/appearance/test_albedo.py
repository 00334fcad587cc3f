"""A known texture recovered from pictures that the pixel model itself made, and what must spoil it."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.appearance.albedo import BRIGHTEST, DARKEST, conjugate_gradients, solve_albedo
from tasks.appearance.atlas import chart_of_texels
from tasks.appearance.colour import linear_from_srgb, srgb8_from_linear
from tasks.appearance.pixels import NormalEquations, shade
from tasks.geometry.faults import BadInput
from tests.appearance.stage_figure import blotches, dressed_scene

SIZE = (64, 64)
RAYS = 64


@pytest.fixture(scope="module")
def staged():
    """A scene with its pictures, 8-bit, rendered with the same transport as the solver's."""
    scene, texture = dressed_scene(frames=2, cameras=6, size=96), blotches(64)
    light = scene.light(scene.trace(rays=RAYS), texture)
    drawn = {(f, k): shade(scene.view(f, k, light[f], SIZE), texture) for f in range(2) for k in range(6)}
    return (
        scene,
        texture,
        {key: srgb8_from_linear(image) for key, (image, _) in drawn.items()},
        {key: covered for key, (_, covered) in drawn.items()},
    )


def solve(scene, images, masks, **options):
    options = {"frames": [0, 1], "texture_size": SIZE, "rays": RAYS, "held_out": [5]} | options
    return solve_albedo(
        lambda f, k: images[f, k],
        lambda f, k: masks[f, k],
        scene.cameras,
        scene.vertices,
        scene.faces,
        scene.uv_vertices,
        scene.uv_faces,
        **options,
    )


def albedo_error(found, texture):
    return np.sqrt(np.mean((found.albedo - texture)[found.observed] ** 2))


def test_the_texture_comes_back(staged):
    """Left are 8-bit rounding and the smoothing of 0.05 against a data weight of order one."""
    scene, texture, images, masks = staged
    found = solve(scene, images, masks)
    assert albedo_error(found, texture) < 0.01
    assert np.nanmin(found.psnr[:, ~found.held_out]) > 42
    assert np.nanmin(found.psnr[:, found.held_out]) > 38
    assert 0.5 < found.observed.mean() < 0.9
    np.testing.assert_array_equal(found.light, 1)
    assert "pixels used" in found.ending


def test_interreflection_needs_the_second_pass():
    """Under the skirt red light is reflected and blue is not; a grey first guess gets both wrong."""
    scene = dressed_scene(frames=1, cameras=4, size=96)
    texture = np.broadcast_to(np.float32([0.9, 0.5, 0.1]), (*SIZE, 3))
    light = scene.light(scene.trace(rays=RAYS), texture)
    drawn = {(0, k): shade(scene.view(0, k, light[0], SIZE), texture) for k in range(4)}
    images, masks = ({key: make(pair) for key, pair in drawn.items()} for make in (lambda p: srgb8_from_linear(p[0]), lambda p: p[1]))
    one, two = (albedo_error(solve(scene, images, masks, frames=[0], held_out=[], passes=n), texture) for n in (1, 2))
    assert two < 0.5 * one


def test_wrong_geometry_is_worse(staged):
    """Negative control: the body 3 cm aside explains the pictures 6 dB worse."""
    scene, _, images, masks = staged
    aside = replace(scene, vertices=scene.vertices + np.array([0.03, 0, 0]))
    right, wrong = solve(scene, images, masks), solve(aside, images, masks)
    assert np.nanmean(wrong.psnr[:, 5]) < np.nanmean(right.psnr[:, 5]) - 6


def test_pictures_held_out_do_not_enter(staged):
    scene, _, images, masks = staged
    spoilt = {key: np.zeros_like(image) if key[1] == 5 else image for key, image in images.items()}
    a, b = solve(scene, images, masks), solve(scene, spoilt, masks)
    np.testing.assert_array_equal(a.albedo, b.albedo)
    assert np.nanmax(b.psnr[:, 5]) < 10


def test_texels_nobody_saw_do_not_score(staged):
    """With one camera most texels are unseen; views of them have no score rather than a bad one, and the seen ones score."""
    scene, _, images, masks = staged
    found = solve(scene, images, masks, held_out=[1, 2, 3, 4, 5], frames=[0])
    assert found.observed.mean() < 0.25
    assert np.isnan(found.psnr[0, 3])  # the camera opposite shares no texel
    assert found.psnr[0, 0] > 35


def test_camera_gains_are_found_up_to_their_common_factor(staged):
    scene, texture, images, masks = staged
    truth = np.array([[1.1, 1, 0.9], [0.9, 1, 1.1], [1, 1.05, 1], [1, 1 / 1.05, 1], [1 / 0.99, 1, 1 / 0.99], [1, 1, 1]])
    tinted = {key: srgb8_from_linear(linear_from_srgb(image) * truth[key[1]]) for key, image in images.items()}
    fitted, fixed = solve(scene, tinted, masks, fit_gain=True), solve(scene, tinted, masks)
    expected = truth[:5] / np.exp(np.log(truth[:5]).mean(0))
    np.testing.assert_allclose(fitted.gain[:5], expected, atol=0.02)  # 6,000 pixels of 5 cm each
    np.testing.assert_allclose(np.exp(np.log(fitted.gain[:5]).mean(0)), 1)
    assert albedo_error(fitted, texture) < 0.5 * albedo_error(fixed, texture)
    assert np.nanmean(fitted.psnr[:, :5]) > np.nanmean(fixed.psnr[:, :5]) + 4
    assert (fitted.gain[5] == 1).all()  # held out


def test_reduced_pictures_give_nearly_the_same(staged):
    scene, texture, images, masks = staged
    found = solve(scene, images, masks, reduce=2)
    assert albedo_error(found, texture) < 0.04
    assert np.nanmin(found.psnr[:, :5]) > 33


def test_conjugate_gradients_reach_the_dense_solution():
    chart = chart_of_texels(np.array([[0.1, 0.1], [0.9, 0.1], [0.2, 0.9]]), np.array([[0, 1, 2]], np.int32), (12, 12))
    equations = NormalEquations((12, 12))
    equations.add_laplacian(chart, 1.0)
    rng = np.random.default_rng(0)
    equations.diagonal()[:] += 10 ** rng.uniform(-3, -1, size=(12, 12, 1)).astype(np.float32)
    free = chart >= 0
    b = rng.random((12, 12, 3)).astype(np.float32)
    A = np.stack([equations.times(e)[..., 0].ravel() for e in np.eye(144, dtype=np.float32).reshape(144, 12, 12, 1).repeat(3, -1)], 1)
    x, residual = conjugate_gradients(equations, b, np.zeros_like(b), free)
    inside = free.ravel()
    expected = np.linalg.solve(A[np.ix_(inside, inside)], b.reshape(144, 3)[inside])
    np.testing.assert_allclose(x.reshape(144, 3)[inside], expected, rtol=2e-3)
    assert residual < 1e-4
    assert (x[~free] == 0).all()


def test_colours_stay_legal(staged):
    scene, _, images, masks = staged
    white = {key: np.full_like(image, 255) for key, image in images.items()}
    found = solve(scene, white, masks)
    assert found.albedo.max() == np.float32(BRIGHTEST)
    assert found.albedo.min() >= np.float32(DARKEST)


def test_a_texture_too_fine_for_the_pictures_is_said_so(staged):
    scene, _, images, masks = staged
    assert "make the texture smaller" in solve(scene, images, masks, texture_size=(256, 256), passes=1).ending
    assert "make the texture smaller" not in solve(scene, images, masks, passes=1).ending


def test_unfit_input_is_refused_with_every_fault(staged):
    scene, _, images, masks = staged
    bad = replace(
        scene,
        uv_vertices=scene.uv_vertices * 2,
        cameras=replace(scene.cameras, distortion=np.full((6, 5), 0.01)),
        vertices=scene.vertices * np.nan,
    )
    with pytest.raises(BadInput) as caught:
        solve(bad, images, masks)
    assert len(caught.value.faults) == 8


def test_a_reduction_by_nothing_is_refused(staged):
    scene, _, images, masks = staged
    with pytest.raises(BadInput, match="reduce: is 0"):
        solve(scene, images, masks, reduce=0)
