"""Before a case is recorded: what discretisation alone does to it, and how strong its causes must be.

Magnitudes are root mean square displacements over the first recording between runs with and without a cause. Rehearsals run on the coarse
mesh in other steps; the magnitude that the truth states is that of the recorded runs on the fine mesh.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tasks.exam.generator import observation
from tasks.exam.generator.causes import Cause, Conditions
from tasks.exam.generator.stepper import State, Stepper
from tasks.exam.generator.subject import FPS, Subject, TooFaint, Unmakeable, states

Array = NDArray[np.float64]
COARSE_STEPS = 3  # per frame
ROUGHEST = 10e-3  # m: a scene in which discretisation does more than this is too chaotic to be asked about
FAINTEST = 1.0  # floors that a cause must reach at its strongest, where less than that is not asked


def rms(d: Array) -> float:
    """√ mean |d|² of displacements [..., 3]."""
    return float(np.sqrt(np.mean(np.sum(d**2, -1))))


def numerics(subject: Subject, plain: Array) -> float:
    """Root mean square distance [m] of the base run `plain` [T, C, 3] from one on the coarse mesh in other steps.

    Both start from the same places, as a diagnosis would start from the first frame. Raises Unmakeable where they part too far.
    """
    stepper = Stepper(subject.world(subject.conditions(subject.garment.coarse), 0))
    zero = np.zeros_like(plain[0])
    start = State(plain[0].copy(), zero, zero, 0.0, stepper.elements.memory(plain[0]))
    x = np.stack([s.x for s in states(stepper, start, COARSE_STEPS)])
    if rms(x - plain) > ROUGHEST:
        raise Unmakeable(f"two meshes of it differ by {1e3 * rms(x - plain):.3g} mm")
    return rms(x - plain)


def least(multiple: float, share: float) -> float:
    """Floors that a cause must reach at its strongest, asked for at `multiple` floors: that share of them, and one where one was asked."""
    return max(share * multiple, min(multiple, FAINTEST))


def strength(cause: Cause, moved: Callable[[float], float], wanted: float, least: float, sign: float) -> float:
    """Strength at which a cause moves the garment by `wanted` [m]; moved(θ) [m] tries one. One trial, a second where the first is far off.

    Where that is more than is plausible the strongest that is serves. Raises TooFaint where even that stays below `least` [m].
    """
    θ = cause.guess
    for _ in range(2):
        ratio = wanted / max(moved(sign * θ), 1e-7)
        needed = θ * ratio ** (1 / cause.order)
        θ = float(np.clip(needed, 0.02 * cause.guess, cause.most))
        if 0.6 < ratio < 1.7:
            break
    share = min(1.0, (cause.most / needed) ** cause.order)
    if share * wanted < least:
        raise TooFaint(f"{cause.name} at its strongest moves it by {1e3 * share * wanted:.3g} mm, not {1e3 * least:.3g}", share)
    return sign * θ


def still_run(subject: Subject, c: Conditions) -> Array:
    """Positions [T, C, 3] of the coarse mesh in the first recording, from where it hangs still under these conditions."""
    stepper = Stepper(subject.world(c, 0))
    return np.stack([s.x for s in states(stepper, subject.still(stepper, 0), COARSE_STEPS)])


def rehearsed(subject: Subject, cause: Cause, θ: float, plain: Array) -> float:
    """Displacement [m] of the coarse mesh under a cause of strength θ, as it would be recorded; plain: its run without, which hung still as well."""
    c = cause.apply(subject.conditions(subject.garment.coarse), θ)
    x = still_run(subject, c) if cause.moves else plain
    return rms(observation.smoothed(x, FPS, c.smoothing) - plain)
