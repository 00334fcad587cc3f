"""The same in other triangles: how far it matters which way the diagonals run.

Bending of a triangle mesh has directions: a grid's diagonals stiffen it across them, and no refinement that keeps them shows it. On the
whole, other diagonals bend as stiffly (`retriangulated.py`).

Strength: 1 is the mesh with other diagonals (`geometry.flips`) [1]. Range: 0 or 1 (from ½ on).
Signature: folds that run along, or across, the diagonals.
Confounders: bending stiffness, fabric_orthotropy; it is computed, never fitted.
Source: Grinspun et al. 2006 on the mesh dependence of hinges. Limits: a rerun, without tangent; seams of the pattern stay.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.effects.retriangulated import retriangulated
from tasks.geometry.flips import flip


class NumericsTriangulation(Effect):
    """Other diagonals."""

    name = "numerics_triangulation"
    kind = "rerun"
    strengths = (Strength("on", "1", 1.0, 0.0, 1.0),)
    keeps = frozenset({"gauge"})

    @override
    def subject(self, subject: Subject, θ: Sequence[float]) -> Subject:
        if θ[0] < 0.5:
            return subject
        faces, uv = flip(subject.cloth.x_rest, subject.cloth.faces, subject.cloth.uv)
        return retriangulated(subject, replace(subject.cloth, faces=np.asarray(faces), uv=uv))


EFFECT = NumericsTriangulation()
