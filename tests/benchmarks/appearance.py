"""The closed-form texture against a known one, against gradient descent, and its cost.

`python -m tests.benchmarks.appearance` prints metric | value | target | holds; JSON=1 the same as JSON, QUICK=1 a small scene and a
twentieth of the descent. Pictures are made by Mitsuba (64 samples per pixel) from a figure in a waving skirt, 8 views, one held out.
VARIANT=cuda_ad_rgb does it on a graphics card: rays, pictures and descent.
"""

import os
import time
from typing import NamedTuple

import numpy as np

from tasks.appearance.albedo import solve_albedo
from tasks.appearance.colour import srgb8_from_linear
from tasks.appearance.inverse_rendering import ACCEPTED_FALL, ITERATIONS, accept, descend
from tasks.appearance.likeness import score_views
from tasks.appearance.path_tracer import PathTracer
from tasks.appearance.transport import RAYS
from tasks.geometry.mitsuba_variant import load_mitsuba
from tests.appearance.stage_figure import blotches, dressed_scene
from tests.benchmarks.table import show

HELD_OUT = 3


class Seconds(NamedTuple):
    """What a piece of work took."""

    cpu: float
    wall: float


def main() -> None:
    """Measure and print."""
    load_mitsuba(os.environ.get("VARIANT"))
    quick = os.environ.get("QUICK") == "1"
    show(_rows(**({"frames": 2, "size": 96, "texture": 64, "steps": 100} if quick else {"frames": 8, "size": 256, "texture": 256})))


def _rows(*, frames: int, size: int, texture: int, steps: int = ITERATIONS):
    scene, truth = dressed_scene(frames=frames, cameras=8, size=size, fineness=3), blotches(texture)
    tracer = PathTracer(scene.cameras, scene.vertices[0], scene.faces, scene.uv_vertices, scene.uv_faces, truth)
    images, masks = _photographs(tracer, scene)
    mesh = scene.vertices, scene.faces, scene.uv_vertices, scene.uv_faces
    options = {"frames": range(frames), "texture_size": (texture, texture), "held_out": [HELD_OUT]}
    solve_albedo(images, masks, scene.cameras, *mesh, **(options | {"frames": [0], "rays": 8}))  # compile
    found, taken = _timed(lambda: solve_albedo(images, masks, scene.cameras, *mesh, **options))
    held, albedo = _held_out(found.psnr), _psnr(found.albedo, truth, found.observed)
    yield f"closed form: CPU seconds, {frames} frames x 7 views x {size}^2", taken.cpu, "< 75", taken.cpu < 75
    yield "closed form: wall seconds", taken.wall, "-", None
    yield "closed form: held-out view, PSNR [dB]", held, "> 34", held > 34
    yield "closed form: albedo on observed texels, PSNR [dB]", albedo, "> 30", albedo > 30
    drawn = {"frames": range(frames), "train": [k for k in range(8) if k != HELD_OUT]}
    verdict = accept(tracer, images, masks, scene.vertices, found.albedo, **drawn)
    yield "fall of the masked loss in 60 prb steps", verdict.fall, f"<= {ACCEPTED_FALL}", verdict.accepted
    grey = np.full_like(found.albedo, 0.5)
    descent, slow = _timed(lambda: descend(tracer, images, masks, scene.vertices, grey, **drawn, iterations=steps))
    light = scene.light(scene.trace(rays=RAYS), descent.albedo)
    seen = score_views(scene, light, descent.albedo, found.observed, images, masks, frames=range(frames))
    yield f"prb descent: CPU seconds, {steps} steps", slow.cpu, "-", None
    yield f"prb descent: wall seconds, {steps} steps", slow.wall, "-", None
    yield "prb descent: held-out view, PSNR [dB]", _held_out(seen), "-", None
    yield "prb descent: albedo on observed texels, PSNR [dB]", _psnr(descent.albedo, truth, found.observed), "-", None
    ratio = ITERATIONS / steps * slow.cpu / taken.cpu
    yield f"CPU seconds of {ITERATIONS} prb steps over the closed form's", ratio, "> 3", ratio > 3


def _photographs(tracer, scene):
    images, masks = {}, {}
    for frame, vertices in enumerate(scene.vertices):
        tracer.move(vertices)
        for k in range(len(scene.cameras)):
            drawn = tracer.render(k, samples=64, seed=100 * frame + k)
            images[frame, k], masks[frame, k] = srgb8_from_linear(drawn[..., :3]), drawn[..., 3]
    return (lambda f, k: images[f, k]), (lambda f, k: masks[f, k])


def _timed(work):
    cpu, wall = time.process_time(), time.perf_counter()
    return work(), Seconds(time.process_time() - cpu, time.perf_counter() - wall)


def _held_out(psnr) -> float:
    return float(np.nanmean(psnr[:, HELD_OUT]))


def _psnr(albedo, truth, where) -> float:
    return float(-10 * np.log10(np.mean((albedo - truth)[where] ** 2)))


if __name__ == "__main__":
    main()
