"""Closed form and gradient descent on the same pictures, made by Mitsuba."""

import numpy as np
import pytest

from tasks.appearance.albedo import solve_albedo
from tasks.appearance.colour import srgb8_from_linear
from tasks.appearance.inverse_rendering import ACCEPTED_FALL, accept, descend, masked_loss
from tasks.appearance.path_tracer import TEXTURE, PathTracer
from tests.appearance.stage_figure import blotches, dressed_scene

SIZE = (48, 48)


@pytest.fixture(scope="module")
def shot():
    """Pictures with 128 samples per pixel of a scene whose texture is known."""
    scene, texture = dressed_scene(frames=2, cameras=4, size=64, fineness=2), blotches(48)
    tracer = PathTracer(scene.cameras, scene.vertices[0], scene.faces, scene.uv_vertices, scene.uv_faces, texture)
    drawn = {}
    for frame in range(2):
        tracer.move(scene.vertices[frame])
        drawn |= {(frame, k): tracer.render(k, samples=128, seed=7 * frame + k) for k in range(4)}
    images, masks = {key: srgb8_from_linear(d[..., :3]) for key, d in drawn.items()}, {key: d[..., 3] for key, d in drawn.items()}
    return scene, texture, tracer, (lambda f, k: images[f, k]), (lambda f, k: masks[f, k])


@pytest.fixture(scope="module")
def solved(shot):
    scene, _, _, images, masks = shot
    mesh = scene.vertices, scene.faces, scene.uv_vertices, scene.uv_faces
    return solve_albedo(images, masks, scene.cameras, *mesh, frames=[0, 1], texture_size=SIZE, held_out=[3])


def test_a_texture_rendered_by_another_program_is_recovered(shot, solved):
    _, texture, *_ = shot
    error = (solved.albedo - texture)[solved.observed]
    assert np.sqrt(np.mean(error**2)) < 0.03
    assert abs(error.mean()) < 0.01
    assert np.nanmin(solved.psnr[:, 3]) > 30


@pytest.mark.slow
def test_the_closed_form_is_accepted(shot, solved):
    scene, _, tracer, images, masks = shot
    verdict = accept(tracer, images, masks, scene.vertices, solved.albedo, frames=[0, 1], train=[0, 1, 2])
    assert verdict.accepted
    assert verdict.fall <= ACCEPTED_FALL


@pytest.mark.slow
def test_a_darkened_texture_is_not_accepted(shot, solved):
    """Negative control: 10 % less albedo leaves a loss that a few steps lower at once."""
    scene, _, tracer, images, masks = shot
    verdict = accept(tracer, images, masks, scene.vertices, 0.9 * solved.albedo, frames=[0, 1], train=[0, 1, 2], iterations=30)
    assert not verdict.accepted
    assert verdict.after < verdict.before


@pytest.mark.slow
def test_the_descent_finds_the_texture_too(shot, solved):
    """Independent of the closed form: Adam from grey gets within a few hundredths of it where pictures decide."""
    scene, texture, tracer, images, masks = shot
    start = np.full_like(solved.albedo, 0.5)
    descent = descend(tracer, images, masks, scene.vertices, start, frames=[0, 1], train=[0, 1, 2], iterations=150)
    assert descent.loss[-20:].mean() < 0.15 * descent.loss[:5].mean()
    seen = solved.observed
    assert np.sqrt(np.mean((descent.albedo - texture)[seen] ** 2)) < 0.5 * np.sqrt(np.mean((start - texture)[seen] ** 2))


def test_the_gradient_is_that_of_the_loss(shot):
    """Path replay against a central difference of the skirt's brightness, same random numbers."""
    import drjit

    scene, texture, tracer, images, masks = shot
    tracer.move(scene.vertices[0])
    patch = np.zeros_like(texture)
    patch[:, 24:] = 1

    def loss(value):
        tracer.paint(value)
        return masked_loss(tracer, images, masks, 0, 0, samples=64, seed=3)

    base = 0.6 * texture
    tracer.paint(base)
    drjit.enable_grad(tracer.params[TEXTURE])
    tracer.params.update()
    drjit.backward(masked_loss(tracer, images, masks, 0, 0, samples=64, seed=3))
    slope = float((np.array(tracer.params[TEXTURE].grad) * patch).sum())
    h = 0.02
    difference = (loss(base + h * patch).array[0] - loss(base - h * patch).array[0]) / (2 * h)
    assert abs(slope) > 1e-4
    np.testing.assert_allclose(slope, difference, rtol=0.1)  # the estimator uses other samples for the adjoint pass
