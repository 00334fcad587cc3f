"""Mitsuba's picture of the scene against the pixel model: two renderers that share no line but the ray tracer."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.appearance.likeness import psnr
from tasks.appearance.path_tracer import PathTracer
from tasks.appearance.pixels import shade
from tasks.geometry.faults import BadInput
from tests.appearance.stage_figure import blotches, dressed_scene

SAMPLES = 128


@pytest.fixture(scope="module")
def traced():
    scene, texture = dressed_scene(frames=2, cameras=3, size=64, fineness=2), blotches(64)
    return scene, texture, PathTracer(scene.cameras, scene.vertices[0], scene.faces, scene.uv_vertices, scene.uv_faces, texture)


def model(scene, texture, frame, camera):
    light = scene.light(scene.trace(rays=256), texture)
    return shade(scene.view(frame, camera, light[frame], texture.shape[:2]), texture)


@pytest.mark.parametrize(("frame", "camera"), [(0, 0), (1, 1)])
def test_two_renderers_agree(traced, frame, camera):
    """Poses, lens (the principal point is off the middle), UV orientation, both sides, shadows and two bounces must all match."""
    scene, texture, tracer = traced
    tracer.move(scene.vertices[frame])
    drawn = tracer.render(camera, samples=SAMPLES)
    image, covered = model(scene, texture, frame, camera)
    inside = (covered == 1) & (drawn[..., 3] > 0.999)
    assert inside.sum() > 150
    np.testing.assert_allclose(drawn[..., 3], covered, atol=0.55)  # an outline pixel may differ by two of the four sub-samples
    assert psnr(drawn[..., :3], image, inside) > 34
    assert (drawn[drawn[..., 3] == 0] == 0).all()  # the sky lights but is not in the picture
    assert abs(np.mean(drawn[inside, :3] - image[inside])) < 0.004


def test_another_place_or_a_flipped_texture_does_not_agree(traced):
    """Negative control of the agreement above."""
    scene, texture, tracer = traced
    image, covered = model(scene, texture, 0, 0)
    tracer.move(scene.vertices[0] + np.array([0, 0.05, 0]))
    assert psnr(tracer.render(0, samples=SAMPLES)[..., :3], image, covered == 1) < 26
    tracer.move(scene.vertices[0])
    tracer.paint(texture[::-1])
    assert psnr(tracer.render(0, samples=SAMPLES)[..., :3], image, covered == 1) < 24
    tracer.paint(texture)
    assert psnr(tracer.render(0, samples=SAMPLES)[..., :3], image, covered == 1) > 30


def test_lenses_that_mitsuba_cannot_express_are_refused():
    scene = dressed_scene(frames=1, cameras=2)
    K = scene.cameras.K.copy()
    K[0, 1, 1] *= 1.1
    with pytest.raises(BadInput, match="square pixels"):
        PathTracer(replace(scene.cameras, K=K), scene.vertices[0], scene.faces, scene.uv_vertices, scene.uv_faces, blotches(16))
