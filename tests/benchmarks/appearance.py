"""The closed-form texture against a known one, against gradient descent, and its cost.

`python -m tests.benchmarks.appearance` prints metric | value | target | holds; JSON=1 the same as JSON, QUICK=1 a small scene.
Pictures are made by Mitsuba (64 samples per pixel) from a figure in a waving skirt, 8 views, one held out. Seconds are processor seconds.
"""

import os
import time

import numpy as np

from tasks.appearance.albedo import solve_albedo
from tasks.appearance.colour import srgb8_from_linear
from tasks.appearance.inverse_rendering import ACCEPTED_FALL, accept, descend
from tasks.appearance.path_tracer import PathTracer
from tests.appearance.stage_figure import blotches, dressed_scene
from tests.benchmarks.table import show

HELD_OUT = 3


def main() -> None:
    """Measure and print."""
    quick = os.environ.get("QUICK") == "1"
    show(_rows(**({"frames": 2, "size": 96, "texture": 64} if quick else {"frames": 8, "size": 256, "texture": 256})))


def _rows(*, frames: int, size: int, texture: int):
    scene, truth = dressed_scene(frames=frames, cameras=8, size=size, fineness=3), blotches(texture)
    tracer = PathTracer(scene.cameras, scene.vertices[0], scene.faces, scene.uv_vertices, scene.uv_faces, truth)
    images, masks = _photographs(tracer, scene)
    mesh = scene.vertices, scene.faces, scene.uv_vertices, scene.uv_faces
    options = {"frames": range(frames), "texture_size": (texture, texture), "held_out": [HELD_OUT]}
    solve_albedo(images, masks, scene.cameras, *mesh, **(options | {"frames": [0], "rays": 8}))  # compile
    found, seconds = _timed(lambda: solve_albedo(images, masks, scene.cameras, *mesh, **options))
    held = float(np.nanmean(found.psnr[:, HELD_OUT]))
    yield f"closed form: CPU seconds, {frames} frames x 7 views x {size}^2", seconds, "< 75", seconds < 75
    yield "closed form: held-out view, PSNR [dB]", held, "> 34", held > 34
    yield (
        "closed form: albedo on observed texels, PSNR [dB]",
        _psnr(found.albedo, truth, found.observed),
        "> 30",
        _psnr(found.albedo, truth, found.observed) > 30,
    )
    train = [k for k in range(8) if k != HELD_OUT]
    verdict = accept(tracer, images, masks, scene.vertices, found.albedo, frames=range(frames), train=train)
    yield "fall of the masked loss in 60 prb steps", verdict.fall, f"<= {ACCEPTED_FALL}", verdict.accepted
    grey = np.full_like(found.albedo, 0.5)
    descent, slow = _timed(lambda: descend(tracer, images, masks, scene.vertices, grey, frames=range(frames), train=train, iterations=50))
    yield "prb descent: CPU seconds for 50 of its 2000 steps", slow, "-", None
    yield "prb descent after 50 steps: albedo PSNR [dB]", _psnr(descent.albedo, truth, found.observed), "-", None
    ratio = 40 * slow / seconds
    yield "cost of 2000 steps over the closed form (extrapolated)", ratio, "> 3", ratio > 3


def _photographs(tracer, scene):
    images, masks = {}, {}
    for frame, vertices in enumerate(scene.vertices):
        tracer.move(vertices)
        for k in range(len(scene.cameras)):
            drawn = tracer.render(k, samples=64, seed=100 * frame + k)
            images[frame, k], masks[frame, k] = srgb8_from_linear(drawn[..., :3]), drawn[..., 3]
    return (lambda f, k: images[f, k]), (lambda f, k: masks[f, k])


def _timed(work):
    start = time.process_time()
    return work(), time.process_time() - start


def _psnr(albedo, truth, where) -> float:
    return float(-10 * np.log10(np.mean((albedo - truth)[where] ** 2)))


if __name__ == "__main__":
    main()
