"""Cloth that is kept off the body by its thickness: pile, lining, undergarments.

    collider + d n    along the vertex normals n of the collider

Strength: d [m]. Range: 0–5 mm (a jersey 0.5, fleece 3); typical 2 mm.
Signature: where cloth lies on the body, along its normals, at all poses alike.
Confounders: body_offset, the same by nature: one class. contact_friction (pressure).
Source: an offset of contact (Codim-IPC) is an inflation of the collider where cloth does not meet itself. Limits: cloth on cloth keeps the
base's distance; normals of vertices, so sharp edges move a little less.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from tasks.effects.effect import Effect, MeshDoubt, Motion, Strength, Subject
from tasks.effects.inflated_body import inflated


class ContactThickness(Effect):
    """Thick cloth."""

    name = "contact_thickness"
    kind = "collider"
    strengths = (Strength("d", "m", 0.002, 0.0, 0.01),)
    keeps = frozenset({"rest", "gauge"})
    confused_with = frozenset({"body_offset", "contact_friction"})

    @override
    def motion(self, subject: Subject, motion: Motion, θ: Sequence[float]) -> Motion:
        return Motion(inflated(motion.collider, subject.collider.faces, θ[0]), motion.boundary)

    @override
    def feigned(self, doubt: MeshDoubt) -> NDArray[np.float64]:
        return np.array([doubt.contact])


EFFECT = ContactThickness()
