"""Predict a garment from what drives it and its first two frames: the whole motion in one run, with and without the named effect.

On about twice the vertices and at half the step: fabric and strengths were fitted with that difference taken off (`cloth/numerics.py`), so it
is the finer computation that they belong to. Where that one ends the earlier, on the given mesh.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.numerics import finer_computed
from tasks.cloth.start_state import States, filled, states, told_by_two
from tasks.cloth.windows import Recording, Window, predict
from tasks.cloth.yielded_collider import yielded_everywhere
from tasks.effects.model import Model

Array = NDArray[np.float64]

GIVEN = 2  # frames


def predicted(model: Model, recording: Recording) -> Array:
    """x [T, V, 3] m from frame 0 on; fewer frames where the simulation ends early."""
    model, recording = recording.scene(model), yielded_everywhere(recording, model)
    whole, start = Window(0, 0, len(recording) - 1), _start(model, recording)
    found = predict(finer_computed(model), recording, whole, start)
    if not found.complete:
        found = max(found, predict(model, recording, whole, start), key=lambda each: len(each.x))
    return found.x[:, : recording.observed.shape[1]]


def _start(model: Model, recording: Recording) -> States:
    """The state of frame 0, as the first frames tell it."""
    first, motion = recording.cut(slice(0, GIVEN)), model.driven(recording.motion).cut(slice(0, GIVEN))
    subject, noise = model.subject, float(np.median(first.noise))
    found = states(_unwatched(model), motion, first.observed, noise)
    seen, _ = filled(first.observed, subject.cloth.faces)
    x0 = found.x[0] if len(found.x) else seen[0]
    v0 = np.zeros_like(x0)
    if len(found.x) == GIVEN:
        between = (each[1] - each[0] for each in (found.x, seen))
        v0 = told_by_two(*(subject.fps * d for d in between), subject.cloth, subject.fps, noise)
    return States(x0[None], v0[None], found.ending)


def _unwatched(model: Model) -> Model:
    """The model without what its tracker does to cloth in time: two frames do not tell what to take back."""
    return replace(model, effects=tuple(e for e in model.effects if "observe" not in e.acts_through))


def held(x: NDArray[np.floating], frames: int) -> NDArray[np.floating]:
    """x [T, V, 3] m with its last state held for as many frames."""
    return np.concatenate([x, np.repeat(x[-1:], frames - len(x), 0)])
