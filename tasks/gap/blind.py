"""Predict a garment from what drives it and its first two frames: the whole motion in one run, with and without the named effect."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.start_state import filled, states, told_by_two
from tasks.cloth.windows import Recording, smooth
from tasks.cloth.yielded_collider import yielded_everywhere
from tasks.effects.model import Model

Array = NDArray[np.float64]

GIVEN = 2  # frames


def predicted(model: Model, recording: Recording) -> Array:
    """x [T, V, 3] m from frame 0 on; fewer frames where the simulation ends early."""
    model, recording = recording.scene(model), yielded_everywhere(recording, model)
    subject, n = model.subject, model.settings.substeps
    first = recording.cut(slice(0, GIVEN))
    noise = float(np.median(first.noise))
    drive = model.drive(recording.motion)
    found = states(_unwatched(model), drive.motion.cut(slice(0, GIVEN)), first.observed, noise)
    seen, _ = filled(first.observed, subject.cloth.faces)
    x0 = found.x[0] if len(found.x) else seen[0]
    v0 = np.zeros_like(x0)
    if len(found.x) == GIVEN:
        between = (each[1] - each[0] for each in (found.x, seen))
        v0 = told_by_two(*(subject.fps * d for d in between), subject.cloth, subject.fps, noise)
    settings = replace(model.settings, substeps=1)
    fine = replace(model, settings=settings, subject=replace(subject, fps=subject.fps * n))
    x = np.stack([f.x for f in fine.run_along(drive.each(lambda motion: smooth(motion, n)), x0, v0)][::n])
    return model.observed(x)


def _unwatched(model: Model) -> Model:
    """The model without what its tracker does to cloth in time: two frames do not tell what to take back."""
    return replace(model, effects=tuple(e for e in model.effects if "observe" not in e.acts_through))


def held(x: NDArray[np.floating], frames: int) -> NDArray[np.floating]:
    """x [T, V, 3] m with its last state held for as many frames."""
    return np.concatenate([x, np.repeat(x[-1:], frames - len(x), 0)])
