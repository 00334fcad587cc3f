"""Before a case is recorded: what discretisation alone does to it, and how strong its causes must be.

Magnitudes are root mean square displacements over the first recording between runs with and without a cause. Rehearsals run on the coarse
mesh in other steps; the magnitude that the truth states is that of the recorded runs on the fine mesh.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tasks.exam.generator import observation
from tasks.exam.generator.causes import Cause
from tasks.exam.generator.stepper import State, Stepper
from tasks.exam.generator.subject import FPS, Subject, Unmakeable, states

Array = NDArray[np.float64]
COARSE_STEPS = 3  # per frame
ROUGHEST = 10e-3  # m: a scene in which discretisation does more than this is too chaotic to be asked about
FAINTEST = 1.0  # floors that a cause must reach at its strongest


def rms(d: Array) -> float:
    """√ mean |d|² of displacements [..., 3]."""
    return float(np.sqrt(np.mean(np.sum(d**2, -1))))


def numerics(subject: Subject, plain: Array) -> tuple[float, Array]:
    """Root mean square distance [m] of the base run `plain` [T, C, 3] from one on the coarse mesh in other steps, and that one.

    Both start from the same places, as a diagnosis would start from the first frame. Raises Unmakeable where they part too far.
    """
    stepper = Stepper(subject.world(subject.conditions(subject.garment.coarse), 0))
    zero = np.zeros_like(plain[0])
    start = State(plain[0].copy(), zero, zero, 0.0, stepper.elements.memory(plain[0]))
    x = np.stack([s.x for s in states(stepper, start, COARSE_STEPS)])
    if rms(x - plain) > ROUGHEST:
        raise Unmakeable(f"two meshes of it differ by {1e3 * rms(x - plain):.3g} mm")
    return rms(x - plain), x


def strength(cause: Cause, moved: Callable[[float], float], wanted: float, floor: float, sign: float) -> float:
    """Strength at which a cause moves the garment by `wanted` [m]; moved(θ) [m] tries one. One trial, a second where the first is far off.

    Where that is more than is plausible the strongest that is serves. Raises Unmakeable where even that stays below the floor.
    """
    θ = cause.guess
    for _ in range(2):
        ratio = wanted / max(moved(sign * θ), 1e-7)
        needed = θ * ratio ** (1 / cause.order)
        θ = float(np.clip(needed, 0.02 * cause.guess, cause.most))
        if 0.6 < ratio < 1.7:
            break
    if needed > (wanted / min(wanted, FAINTEST * floor)) ** (1 / cause.order) * cause.most:
        raise Unmakeable(f"{cause.name} at its strongest stays below the floor of {1e3 * floor:.3g} mm")
    return sign * θ


def rehearsed(subject: Subject, cause: Cause, θ: float, plain: Array) -> float:
    """Displacement [m] of the coarse mesh, whose base run is `plain`, under a cause of strength θ, as it would be recorded."""
    x, c = plain, cause.apply(subject.conditions(subject.garment.coarse), θ)
    if cause.moves:
        stepper = Stepper(subject.world(c, 0))
        x = np.stack([s.x for s in states(stepper, subject.still(stepper, 0), COARSE_STEPS)])
    return rms(observation.smoothed(x, FPS, c.smoothing) - plain)
