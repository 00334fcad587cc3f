"""A recording's collider, drawn in once per frame where it pinches itself near the cloth or covers driven nodes (`simulator/yielding.py`).

A single simulation lets the collider give way as it goes. Many simulations of the same windows must all meet the same collider, or their differences
would mean nothing; so it gives way beforehand, to the cloth as it was seen, and the simulations then take it as it is.
"""

from dataclasses import replace

import numpy as np

from tasks.cloth.start_state import filled
from tasks.cloth.windows import Recording
from tasks.effects.effect import Motion
from tasks.effects.model import Model
from tasks.simulator.yielding import give_way


def with_yielded_collider(recording: Recording, model: Model) -> Recording:
    """The recording with its collider drawn in; the settings to simulate it with have `yield_collider` off."""
    faces, settings = recording.collider.faces, model.settings
    if not len(faces):
        return recording
    clearance = 2 * settings.barrier_distance + settings.contact_offset
    x, _ = filled(recording.observed, model.subject.cloth.faces)
    motion = recording.motion
    each = zip(motion.collider, x, motion.boundary, strict=True)
    collider = np.stack([give_way(c, faces, cloth=cloth, pins=pins, clearance=clearance)[0] for c, cloth, pins in each])
    return replace(recording, motion=Motion(collider, motion.boundary))
