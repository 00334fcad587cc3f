"""A recording's collider, drawn in once per frame where it pinches itself near the cloth or covers driven nodes (`simulator/yielding.py`).

A single simulation lets the collider give way as it goes. Many simulations of the same windows must all meet the same collider, or their
differences would mean nothing; so it gives way beforehand, to the cloth as it was seen, and the simulations then take it as it is. Where
the cloth will be, nobody has seen (a prediction), it gives way wherever it pinches itself. An effect that moves the collider can close what
was open: so it gives way as it is once the model's effects have moved it, and what it gave way by is kept beside the recorded one.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.start_state import filled
from tasks.cloth.windows import Recording
from tasks.effects.effect import Motion
from tasks.effects.model import Model
from tasks.simulator.yielding import give_way

Array = NDArray[np.float64]


def with_yielded_collider(recording: Recording, model: Model) -> Recording:
    """The recording with its collider drawn in near the cloth that was observed; the settings to simulate it with have `yield_collider` off."""
    x, _ = filled(recording.observed, model.subject.cloth.faces)
    return replace(recording, motion=_yielded(recording, model, x))


def yielded_everywhere(recording: Recording, model: Model) -> Recording:
    """The same where only what drives the cloth is known."""
    return replace(recording, motion=_yielded(recording, model, recording.motion.collider))


def _yielded(recording: Recording, model: Model, near: Array) -> Motion:
    """The motion with the collider drawn in wherever it is, as driven, close to points `near` [T, N, 3] m."""
    motion, faces, settings = replace(recording.motion, yielded=None), recording.collider.faces, model.settings
    if not len(faces):
        return motion
    clearance, driven = 2 * settings.barrier_distance + settings.contact_offset, recording.scene(model).driven(motion)
    each = zip(driven.collider, near, driven.boundary, strict=True)
    held = model.subject.cloth.held_edges
    drawn = np.stack([give_way(c, faces, cloth=x, pins=pins, clearance=clearance, held_edges=held)[0] for c, x, pins in each])
    return replace(motion, yielded=drawn - driven.collider)
