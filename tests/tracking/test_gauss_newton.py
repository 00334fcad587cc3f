"""One Gauss–Newton step against its dense twin; energies fall and settle."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.tracking import blocks, outline, pyramid, reference
from tasks.tracking.gauss_newton import Instant, Scene, fit, linearise, look, pixel_size
from tasks.tracking.settings import Settings
from tasks.tracking.surface import shape, surface
from tasks.tracking.visibility import facing_cosines
from tests.tracking import dense_step
from tests.tracking.skirt import ring

SETTINGS = Settings(blur_px=(4.0, 1.5), steps=(4, 6), sigma_strain=0.2)  # loose, so that no term drowns the others


def patch(rows=3, columns=3, spacing=0.06):
    """A gently curved patch [V, 3] that faces the first camera of the ring, and its faces."""
    v, u = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    flat = np.stack([(u - (columns - 1) / 2) * spacing, 0.5 + (v - (rows - 1) / 2) * spacing, 0.01 * np.sin(u + 2.0 * v)], -1).reshape(
        -1, 3
    )
    a = (v * columns + u)[:-1, :-1].ravel()
    faces = np.concatenate([np.column_stack([a, a + 1, a + columns]), np.column_stack([a + 1, a + columns + 1, a + columns])])
    return flat, faces.astype(np.int32)


@pytest.fixture(scope="module")
def problem():
    """A patch before two cameras whose images are smooth noise, displaced from where its colours were taken."""
    import cv2

    template, faces = patch()
    cameras = ring(6, 96).subset([0, 5])
    rng = np.random.default_rng(4)
    pictures = [cv2.GaussianBlur(rng.uniform(0, 1, (h, w, 3)), (0, 0), 3) * 3 - 1 for w, h in cameras.size]
    masks = [np.hypot(*(np.indices(p.shape[:2]) - np.array(p.shape[:2])[:, None, None] / 2)) < 14 for p in pictures]
    stacked = pyramid.stack(lambda t, k: pictures[k], lambda t, k: masks[k], 0, cameras)
    levels = tuple(pyramid.level(stacked, b) for b in SETTINGS.blur_px)
    mesh = surface(template, faces, np.array(["body"] * 4 + ["top"] * 4), SETTINGS)
    cosine = facing_cosines(template, mesh, cameras, occluder=None, side=None, facing=0.2, settings=SETTINGS)
    prediction = template + 0.01 * rng.standard_normal(template.shape)
    prediction[5:] = np.nan
    scene = Scene(mesh, cameras, reference.take(template, mesh, list(levels), cameras, cosine), SETTINGS, pixel_size(cameras, template))
    instant = Instant(levels, outline.outlines(stacked), shape(mesh, template, prediction, template, SETTINGS), None)
    return scene, instant, template + 0.004 * rng.standard_normal(template.shape)


@pytest.mark.parametrize("number", [0, 1])
def test_fast_assembly_is_the_dense_step(problem, number):
    scene, instant, x = problem
    view = look(scene, instant, x)
    assert (view.weight > 0).sum() > 20 and len(view.rim.face) > 20
    H, g, δ = dense_step.step(x, scene, instant, number, view, damping=200.0)
    _, system = linearise(scene, instant, number, x, view)
    assert np.allclose(system.gradient.ravel(), g, rtol=0, atol=1e-6 * np.abs(g).max())
    assert np.allclose(blocks.dense(system), H, rtol=0, atol=1e-6 * np.abs(H).max())
    assert np.allclose(blocks.solve(system, damping=200.0, tolerance=1e-12, cap=500)[0], δ, rtol=0, atol=1e-5 * np.abs(δ).max())


def test_another_weight_is_another_step(problem):
    scene, instant, x = problem
    view = look(scene, instant, x)
    _, g, _ = dense_step.step(x, scene, instant, 1, view, damping=200.0)
    other = replace(scene, settings=replace(scene.settings, sigma_normal=0.33))
    assert not np.allclose(linearise(other, instant, 1, x, view)[1].gradient.ravel(), g, rtol=0, atol=1e-3 * np.abs(g).max())


@pytest.mark.parametrize("number", [0, 1])
def test_gradient_is_the_derivative_of_the_energy(problem, number):
    scene, instant, x = problem
    view = look(scene, instant, x)
    _, system = linearise(scene, instant, number, x, view)
    along = np.random.default_rng(6).standard_normal(x.shape)
    h = 1e-6
    forward, backward = (linearise(scene, instant, number, x + s * h * along, view)[0] for s in (1, -1))
    assert np.isclose((forward - backward) / (2 * h), (system.gradient * along).sum(), rtol=1e-5)


def test_fit_goes_downhill_and_says_how_it_ended(problem):
    scene, instant, x = problem
    found = fit(scene, instant, x)
    view = look(scene, instant, found.x)
    assert linearise(scene, instant, 1, found.x, view)[0] < linearise(scene, instant, 1, x, view)[0]
    assert "1.5 px" in found.ending and np.isfinite(found.last_step)
