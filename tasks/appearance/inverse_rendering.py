"""Albedo by differentiable path tracing: PhysAvatar supplement A.4, and the acceptance check of the closed form.

`descend` is the supplement's protocol: at each iteration one timestep and one view drawn at random, 8 samples per pixel, masked mean
square in linear light, Adam at 0.01 halved every 500 iterations, texture clipped after each step; 2000 iterations. The light stays at
L_a = 1 (the gauge of `albedo.py`; the authors' released code keeps it fixed too).

`accept` asks whether a solution is one: it lets the same descent run for some iterations from the closed form, at the rate the schedule has
reached by its end, and says by what share the masked loss over fixed images still fell. Both losses are taken with the same random numbers,
so that the noise of few samples cancels in the comparison.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.appearance.albedo import BRIGHTEST, DARKEST
from tasks.appearance.observations import Images, Masks, observe
from tasks.appearance.path_tracer import TEXTURE, PathTracer

Array = NDArray[np.float64]

ITERATIONS, SAMPLES, RATE, HALVING = 2000, 8, 0.01, 500  # supplement A.4
POLISH, POLISH_RATE = 60, 0.001  # iterations, rate: below the 0.00125 with which the schedule ends
ACCEPTED_FALL = 0.1  # [-] of the masked loss


@dataclass(frozen=True)
class Descent:
    """albedo [h, w, 3] linear and the masked loss of each iteration (of another random image each)."""

    albedo: NDArray[np.float32]
    loss: Array


@dataclass(frozen=True)
class Acceptance:
    """Masked loss before and after a polish, the share by which it fell, whether that is little enough, and the polished albedo."""

    before: float
    after: float
    fall: float
    accepted: bool
    albedo: NDArray[np.float32]


def descend(
    tracer: PathTracer,
    images: Images,
    masks: Masks,
    vertices: Array,
    albedo: NDArray,
    *,
    frames: Sequence[int],
    train: Sequence[int],
    iterations: int = ITERATIONS,
    samples: int = SAMPLES,
    rate: float = RATE,
    seed: int = 0,
) -> Descent:
    """Adam on the texture from `albedo` [h, w, 3]; vertices [T, V, 3] m, `frames` of T and `train`ing cameras to draw from."""
    import drjit

    mi, rng = tracer.mi, np.random.default_rng(seed)
    tracer.paint(albedo)
    adam = mi.ad.Adam(lr=rate)
    adam[TEXTURE] = tracer.params[TEXTURE]
    loss = np.zeros(iterations)
    for n in range(iterations):
        adam.set_learning_rate(rate * 0.5 ** (n // HALVING))
        frame, camera = int(rng.choice(frames)), int(rng.choice(train))
        tracer.move(vertices[frame])
        tracer.params.update(adam)
        error = masked_loss(tracer, images, masks, frame, camera, samples=samples, seed=n)
        drjit.backward(error)
        adam.step()
        adam[TEXTURE] = drjit.clip(adam[TEXTURE], DARKEST, BRIGHTEST)
        loss[n] = drjit.detach(error).array[0]
    return Descent(np.array(adam[TEXTURE]), loss)


def accept(
    tracer: PathTracer,
    images: Images,
    masks: Masks,
    vertices: Array,
    albedo: NDArray,
    *,
    frames: Sequence[int],
    train: Sequence[int],
    iterations: int = POLISH,
    seed: int = 0,
) -> Acceptance:
    """Whether a short descent from `albedo` lowers the masked loss by at most `ACCEPTED_FALL`; scored on one image of every frame."""
    fixed = [(frame, train[i % len(train)]) for i, frame in enumerate(frames)]
    before = _mean_loss(tracer, images, masks, vertices, albedo, fixed)
    polished = descend(
        tracer, images, masks, vertices, albedo, frames=frames, train=train, iterations=iterations, rate=POLISH_RATE, seed=seed
    ).albedo
    after = _mean_loss(tracer, images, masks, vertices, polished, fixed)
    fall = 1 - after / before
    return Acceptance(before, after, fall, fall <= ACCEPTED_FALL, polished)


def masked_loss(tracer: PathTracer, images: Images, masks: Masks, frame: int, camera: int, *, samples: int, seed: int):
    """Mean square over the usable pixels of one image, as a differentiable Dr.Jit scalar; the mesh must stand at that frame."""
    import drjit

    image, usable = observe(images, masks, frame, camera)
    weight = np.repeat(usable[..., None], 3, -1).astype(np.float32) / max(3 * int(usable.sum()), 1)
    shown = tracer.mi.render(tracer.scene, tracer.params, sensor=tracer.sensors[camera], spp=samples, seed=seed)[..., :3]
    return drjit.sum(tracer.mi.TensorXf(weight) * drjit.square(shown - tracer.mi.TensorXf(image)), axis=None)


def _mean_loss(tracer, images, masks, vertices, albedo, pairs) -> float:
    tracer.paint(albedo)
    total = 0.0
    for seed, (frame, camera) in enumerate(pairs):
        tracer.move(vertices[frame])
        total += masked_loss(tracer, images, masks, frame, camera, samples=4 * SAMPLES, seed=seed).array[0]
    return total / len(pairs)
