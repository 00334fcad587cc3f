"""A waistband that slips: driven nodes creep down the body and do not follow all of its turns.

    b(t) = c(t) + R_y(−q ψ(t)) (b̂(t) − c(t)) − u (t − t₀) ŷ

b̂: the boundary as given, c its centroid, ψ its turn about the vertical since the first frame (best turn in the horizontal plane).
Strengths: u [m/s], creep along gravity; q [1], the share of turns that is slipped. Range: u ±0.02 m/s; q 0–0.3; typical 0.005 and 0.05.
Signature: the whole garment lower and lower; a twist against the body, in phase with its turns.
Confounders: contact_friction, body_lag and observation_delay (turns a moment late: out of phase).
Source: the two rigid motions of a band on a body that keep it on the body, with rates held constant. Limits: rigid; one u and q for all
bands; relative to the first frame; nothing to see where the boundary is what the tracker saw of the garment itself.
"""

from collections.abc import Sequence

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Array, Effect, Motion, Strength, Subject


class BoundarySlip(Effect):
    """Driven nodes that slip."""

    name = "boundary_slip"
    kind = "collider"
    strengths = (Strength("u", "m/s", 0.005, -0.02, 0.02), Strength("q", "1", 0.05, 0.0, 0.3))
    keeps = frozenset({"gauge"})
    confused_with = frozenset({"contact_friction", "body_lag", "observation_delay"})

    @override
    def motion(self, subject: Subject, motion: Motion, θ: Sequence[float]) -> Motion:
        b, (u, q) = motion.boundary, θ
        if not b.size or not (u or q):
            return motion
        arm = b - b.mean(1, keepdims=True)
        down = np.arange(len(b))[:, None] / subject.fps * np.array([0, u, 0])
        return Motion(motion.collider, b + _turned(arm, -q * turns(b)) - arm - down[:, None])


def turns(boundary: Array) -> Array:
    """ψ [T] rad about +y of nodes [T, B, 3] m since the first frame."""
    z, x = (np.moveaxis(boundary - boundary.mean(1, keepdims=True), 2, 0)[k] for k in (2, 0))
    cosine, sine = (z * z[0] + x * x[0]).sum(1), (x * z[0] - z * x[0]).sum(1)
    return np.unwrap(np.arctan2(sine, cosine))


def _turned(arm: Array, ψ: Array) -> Array:
    """arm [T, B, 3] turned about +y by ψ [T]."""
    c, s = np.cos(ψ)[:, None], np.sin(ψ)[:, None]
    x, y, z = np.moveaxis(arm, 2, 0)
    return np.stack([c * x + s * z, y, c * z - s * x], 2)


EFFECT = BoundarySlip()
