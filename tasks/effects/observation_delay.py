"""A garment that was recorded late: it and its boundary are seen as they were τ ago, against the collider.

    collider(t) = recorded collider(t − τ), by a cubic spline in time

The clock is the garment's: on it garment, boundary and start are right as recorded, and the collider is early by τ. A delay common to
all is nothing that could be seen.
Strength: τ [s], positive where the garment is late. Range: 0–2 frames, at 30 fps 0–0.07 s; typical one frame, 0.033 s.
Signature: where the body touches cloth, along its velocity; one frame at 1 m/s is 33 mm.
Confounders: body_lag, its exact opposite: one class. boundary_slip where the body turns.
Source: synchronisation of cameras and trackers. Limits: one delay for the whole recording; beyond the ends of the recording the body is
taken to go straight on; without a collider the delay is not testable.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from tasks.effects.effect import Effect, MeshDoubt, Motion, Strength, Subject
from tasks.effects.paths_in_time import later


class ObservationDelay(Effect):
    """A late garment."""

    name = "observation_delay"
    kind = "observation"
    strengths = (Strength("τ", "s", 0.033, -0.1, 0.1),)
    keeps = frozenset({"rest", "statics", "gauge"})
    confused_with = frozenset({"body_lag", "boundary_slip"})

    @override
    def motion(self, subject: Subject, motion: Motion, θ: Sequence[float]) -> Motion:
        return Motion(later(motion.collider, -θ[0] * subject.fps), motion.boundary)

    @override
    def feigned(self, doubt: MeshDoubt) -> NDArray[np.float64]:
        return np.array([doubt.arrival])


EFFECT = ObservationDelay()
