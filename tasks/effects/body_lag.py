"""A body that was recorded late: each frame shows the collider as it was τ ago, against garment and boundary.

    collider(t) = recorded collider(t + τ), by a cubic spline in time

Strength: τ [s], positive where the collider is late. Range: 0–2 frames, at 30 fps 0–0.07 s; typical one frame, 0.033 s.
Signature: where the body touches cloth, along its velocity; nothing where nothing touches.
Confounders: observation_delay, its exact opposite: one class. boundary_slip where the body turns.
Source: synchronisation of two trackers; smoothing of the body's poses from the past. Limits: one delay for the whole body; beyond the ends
of the recording the body is taken to go straight on, so give a few frames more than are compared.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from tasks.effects.effect import Effect, MeshDoubt, Motion, Strength, Subject
from tasks.effects.paths_in_time import later


class BodyLag(Effect):
    """A late collider."""

    name = "body_lag"
    kind = "collider"
    strengths = (Strength("τ", "s", 0.033, -0.1, 0.1),)
    keeps = frozenset({"rest", "statics", "gauge"})
    confused_with = frozenset({"observation_delay", "boundary_slip"})

    @override
    def motion(self, subject: Subject, motion: Motion, θ: Sequence[float]) -> Motion:
        return Motion(later(motion.collider, θ[0] * subject.fps), motion.boundary)

    @override
    def feigned(self, doubt: MeshDoubt) -> NDArray[np.float64]:
        return np.array([doubt.arrival])


EFFECT = BodyLag()
