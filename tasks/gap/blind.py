"""Predict a garment from what drives it and its first two frames: the whole motion in one run, with and without the named effect.

On about twice the vertices and at half the step: fabric and strengths were fitted with that difference taken off (`cloth/numerics.py`), so it
is the finer computation that they belong to. Where that one ends the earlier, on the given mesh.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.numerics import finer_computed
from tasks.cloth.start_state import filled, states, told_by_two
from tasks.cloth.windows import Recording, smooth
from tasks.cloth.yielded_collider import yielded_everywhere
from tasks.effects.effect import Motion
from tasks.effects.model import Model

Array = NDArray[np.float64]

GIVEN = 2  # frames


def predicted(model: Model, recording: Recording) -> Array:
    """x [T, V, 3] m from frame 0 on; fewer frames where the simulation ends early."""
    model, recording = recording.scene(model), yielded_everywhere(recording, model)
    start = _start(model, recording)
    x = _run(finer_computed(model), recording.motion, *start)
    if len(x) < len(recording):
        x = max(x, _run(model, recording.motion, *start), key=len)
    return model.observed(x[:, : recording.observed.shape[1]])


def _start(model: Model, recording: Recording) -> tuple[Array, Array]:
    """x [V, 3] m and v [V, 3] m/s that the first frames tell."""
    first, motion = recording.cut(slice(0, GIVEN)), model.driven(recording.motion).cut(slice(0, GIVEN))
    subject, noise = model.subject, float(np.median(first.noise))
    found = states(_unwatched(model), motion, first.observed, noise)
    seen, _ = filled(first.observed, subject.cloth.faces)
    x0 = found.x[0] if len(found.x) else seen[0]
    if len(found.x) < GIVEN:
        return x0, np.zeros_like(x0)
    between = (each[1] - each[0] for each in (found.x, seen))
    return x0, told_by_two(*(subject.fps * d for d in between), subject.cloth, subject.fps, noise)


def _run(model: Model, motion: Motion, x0: Array, v0: Array) -> Array:
    """x [T, V, 3] m at the frames of a recorded motion, which is smooth between them."""
    drive, settings, n = model.drive(motion), model.settings, model.settings.substeps
    fine = replace(model, settings=replace(settings, substeps=1), subject=replace(model.subject, fps=model.subject.fps * n))
    return np.stack([f.x for f in fine.run_along(drive.each(lambda motion: smooth(motion, n)), x0, v0)][::n])


def _unwatched(model: Model) -> Model:
    """The model without what its tracker does to cloth in time: two frames do not tell what to take back."""
    return replace(model, effects=tuple(e for e in model.effects if "observe" not in e.acts_through))


def held(x: NDArray[np.floating], frames: int) -> NDArray[np.floating]:
    """x [T, V, 3] m with its last state held for as many frames."""
    return np.concatenate([x, np.repeat(x[-1:], frames - len(x), 0)])
