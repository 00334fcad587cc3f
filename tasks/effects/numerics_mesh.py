"""The same on a finer mesh: how far the mesh is from not mattering.

Each round splits the longest edge of every triangle (`geometry.refinement`), which about doubles the vertices; the given ones stay first.
Hinges bend as stiffly as those of the given mesh (`retriangulated.py`): with its κ_b, equilateral triangles cut in halves would be three
tenths stiffer.
Strength: rounds [1]. Range: 0–2; rounded.
Signature: the length of wrinkles, folds that the given mesh cannot make, softer bending of coarse folds.
Confounders: bending stiffness, fabric_rest_scale, fabric_stiffening; it is computed and taken off before any of them is named.
Source: Rivara 1984 (bisection). Limits: the new rest shape is the old one with midpoints, flat between old edges; a rerun, without tangent.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Array, Effect, Motion, Strength, Subject
from tasks.effects.retriangulated import retriangulated
from tasks.geometry.refinement import Refinement, refine
from tasks.simulator import Cloth


class NumericsMesh(Effect):
    """A finer mesh."""

    name = "numerics_mesh"
    kind = "rerun"
    strengths = (Strength("rounds", "1", 1.0, 0.0, 2.0),)
    keeps = frozenset({"gauge"})

    @override
    def subject(self, subject: Subject, θ: Sequence[float]) -> Subject:
        finer = subject
        for _ in range(round(θ[0])):
            finer = _finer(finer, _split(finer.cloth))
        return subject if finer is subject else replace(retriangulated(subject, finer.cloth), zone=finer.zone)

    @override
    def start(self, subject: Subject, x: Array, θ: Sequence[float]) -> Array:
        for _ in range(round(θ[0])):
            step = _split(subject.cloth)
            subject, x = _finer(subject, step), step.field(x)
        return x

    @override
    def motion(self, subject: Subject, motion: Motion, θ: Sequence[float]) -> Motion:
        boundary = motion.boundary
        for _ in range(round(θ[0])):
            step, fixed = _split(subject.cloth), subject.cloth.boundary
            place = np.full(len(subject.cloth.x_rest), -1)
            place[fixed] = np.arange(len(fixed))
            boundary = np.concatenate([boundary, boundary[:, place[step.parents[_driven(step, fixed)]]].mean(2)], 1)
            subject = _finer(subject, step)
        return Motion(motion.collider, boundary)


def _split(cloth: Cloth) -> Refinement:
    return refine(cloth.x_rest, cloth.faces)


def _driven(step: Refinement, boundary: Array) -> Array:
    """New vertices [N] bool between two driven ones."""
    return np.isin(step.parents, boundary).all(1)


def _finer(subject: Subject, step: Refinement) -> Subject:
    cloth, zone = subject.cloth, subject.zone
    new = len(zone) + np.flatnonzero(_driven(step, cloth.boundary))
    finer = Cloth(
        step.field(cloth.x_rest),
        step.faces,
        np.concatenate([cloth.boundary, new]).astype(np.int32),
        None if cloth.uv is None else step.corners(cloth.uv),
        cloth.rest_angles,
    )
    ends = zone[step.parents]
    return replace(subject, cloth=finer, zone=np.concatenate([zone, np.where(ends[:, 0] == ends[:, 1], ends[:, 0], "free")]))


EFFECT = NumericsMesh()
