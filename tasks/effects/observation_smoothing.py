"""A tracker that smooths in time: what is seen is a Gaussian average over neighbouring frames.

    x_seen = exp(½ τ² ∂²/∂t²) x = x + ½ τ² ẍ + …,      boundary = b − ½ τ² b̈  of the boundary seen

∂² is the second difference of frames, the acceleration held constant beyond both ends; its exponential is the discrete Gaussian of
variance τ². A sine of rate ω keeps exp(−τ² f² (1 − cos(ω/f))) of its amplitude at f frames per second. The boundary was smoothed as
well, and it drives the cloth: the smoothing is taken back to first order only, because all of it would make noise explode.
Strength: τ² [s²], so that the tangent at zero is ½ ẍ. Range: τ 0.5–3 frames, at 30 fps to 0.1 s: τ² to 0.01; typical one frame, 1.1e-3 s².
Signature: everywhere, also at driven nodes, which no physics moves; high frequencies; rounds off impacts.
Confounders: fabric_bending_damping, fabric_membrane_damping and air_normal_drag damp too, yet not at driven nodes; observation_delay if
the smoothing looks back only.
Source: Lindeberg 1990 (discrete Gaussian); low-pass of trackers. Limits: time only, not space; symmetric; start states are sharpened to
first order only.
"""

from collections.abc import Sequence

import numpy as np
from scipy.linalg import expm
from typing_extensions import override

from tasks.effects.effect import Array, Effect, MeshDoubt, Motion, Strength, Subject


class ObservationSmoothing(Effect):
    """Temporal low-pass."""

    name = "observation_smoothing"
    kind = "observation"
    strengths = (Strength("τ²", "s2", 1.1e-3, 0.0, 0.01),)
    keeps = frozenset({"rest", "statics", "momentum", "gauge"})
    confused_with = frozenset({"fabric_bending_damping", "fabric_membrane_damping", "air_normal_drag"})

    @override
    def feigned(self, doubt: MeshDoubt) -> Array:
        return np.array([doubt.calmed])

    @override
    def motion(self, subject: Subject, motion: Motion, θ: Sequence[float]) -> Motion:
        if not θ[0]:
            return motion
        D = _second_difference(len(motion.boundary))
        return Motion(motion.collider, motion.boundary - np.tensordot(_spread(θ, subject) * D, motion.boundary, 1))

    @override
    def observe(self, subject: Subject, x: Array, θ: Sequence[float]) -> Array:
        if not θ[0]:
            return x
        return np.tensordot(expm(_spread(θ, subject) * _second_difference(len(x))), x, 1)


def _spread(θ: Sequence[float], subject: Subject) -> float:
    """½ τ² in frames squared."""
    return 0.5 * θ[0] * subject.fps**2


def _second_difference(T: int) -> Array:
    """[T, T]; the ends take the value beside them."""
    D = np.eye(T, k=1) - 2 * np.eye(T) + np.eye(T, k=-1)
    if T < 3:
        return 0 * D
    D[0], D[-1] = D[1], D[-2]
    return D


EFFECT = ObservationSmoothing()
