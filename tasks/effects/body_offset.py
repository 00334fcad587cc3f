"""A body fitted too thin or too thick: the skin lies d outside of where it was put.

    collider + d n    along the vertex normals n of the collider

Strength: d [m], positive where the true body is larger. Range: ±2–20 mm (fits through clothes; soft tissue); typical 8 mm.
Signature: where cloth lies on the body, along its normals, at all poses alike.
Confounders: contact_thickness, the same by nature (measured |cos| 0.99): one class. contact_friction (pressure).
Source: residuals of body fits. Limits: the same everywhere, while a fit errs differently at waist and chest; the collider only, driven
nodes stay; tissue that moves is not in it.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from tasks.effects.effect import Effect, MeshDoubt, Motion, Strength, Subject
from tasks.effects.inflated_body import inflated


class BodyOffset(Effect):
    """A larger body."""

    name = "body_offset"
    kind = "collider"
    strengths = (Strength("d", "m", 0.008, -0.02, 0.02),)
    keeps = frozenset({"rest", "gauge"})
    confused_with = frozenset({"contact_thickness", "contact_friction"})

    @override
    def motion(self, subject: Subject, motion: Motion, θ: Sequence[float]) -> Motion:
        return Motion(inflated(motion.collider, subject.collider.faces, θ[0]), motion.boundary)

    @override
    def feigned(self, doubt: MeshDoubt) -> NDArray[np.float64]:
        return np.array([doubt.contact])


EFFECT = BodyOffset()
