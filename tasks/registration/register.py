"""The body registered to tracked skin: shape and poses that bring its surface to where skin was seen.

Keypoints from a detector are some centimetres off where clothes hide a joint or the detector errs in one way on every image; skin is tracked to millimetres.
From the keypoint fit on, points of the body closest to tracked skin are found and drawn to it in turn (iterated closest points; Besl & McKay 1992), with
the priors of the keypoint fit about its own poses: what no skin shows stays where the keypoints put it. One shape, from a few frames together, then every
frame for itself.

Limits: garments are no skin, and hair and shoes are taken for it as far as 3 cm; a person of whom little skin is seen gets little from it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.body.levenberg_marquardt import minimise
from tasks.body.model import Array, BodyModel
from tasks.body.objective import FitWeights, Objective
from tasks.geometry.meshes import vertex_normals
from tasks.registration.skin_distance import Match, SkinDistance, matched

USED = 500  # tracked vertices
SHAPE_FRAMES = 5
ROUNDS, FRAME_ROUNDS = 8, 4  # of matching: for the shape, and for each frame
STEPS = 6  # of Gauss-Newton between two of them
FEWEST = 100  # tracked skin vertices without which the body stays as it was


@dataclass(frozen=True)
class Pose:
    """pose [frame, 55, 3] rad, shape [S], expression [frame, E], translation [frame, 3] m."""

    pose: Array
    shape: Array
    expression: Array
    translation: Array


@dataclass(frozen=True)
class Skin:
    """Tracked surface vertices [frame, V, 3] m, faces [F, 3], which vertices are skin [n], and where they were seen [frame, V]."""

    vertices: Array
    faces: NDArray[np.int32]
    index: NDArray[np.int64]
    seen: NDArray[np.bool_]

    def at(self, frame: int) -> tuple[Array, Array]:
        """Some of the skin that was seen [n, 3] m, and its normals [n, 3]."""
        own = self.index[self.seen[frame, self.index]]
        own = own[np.linspace(0, len(own) - 1, min(USED, len(own))).round().astype(int)] if len(own) else own
        x = self.vertices[frame]
        known = self.faces[np.isfinite(x).all(-1)[self.faces].all(1)]
        return x[own], vertex_normals(x, known)[own]


@dataclass(frozen=True)
class Registered:
    """The pose, the median distance [frame, 2] m of matched skin from the body before and after, and how it ended."""

    found: Pose
    distance: Array
    ending: str


def register(model: BodyModel, start: Pose, skin: Skin, tell: Callable[[float, str], None] = lambda share, text: None) -> Registered:
    """Shape and poses that the tracked skin asks for, from those that keypoints gave."""
    frames = len(start.pose)
    enough = [f for f in range(frames) if skin.seen[f, skin.index].sum() >= FEWEST]
    if not enough:
        return Registered(start, np.full((frames, 2), np.nan), "too little skin was tracked: as keypoints had it")
    free = Objective.of(model, FitWeights())
    z = np.array([free.unknowns(pose, t) for pose, t in zip(start.pose, start.translation, strict=True)])
    some = [enough[i] for i in np.linspace(0, len(enough) - 1, SHAPE_FRAMES).round().astype(int)]
    shape = _shape(model, free, start, z, skin, some, tell)
    found, distance = z.copy(), np.full((frames, 2), np.nan)
    for f in enough:
        tell(0.4 + 0.6 * f / frames, f"frame {f}")
        found[f], distance[f] = _frame(model, free, start, z[f], shape, skin, f)
    pose = np.array([free.pose(u) for u in found])
    pose[:, FACE] = start.pose[:, FACE]
    before, after = 1e3 * np.nanmedian(distance, 0)
    return Registered(
        Pose(pose, shape, start.expression, found[:, :3]),
        distance,
        f"skin lies {after:.1f} mm from the body, {before:.1f} mm before, medians of {len(enough)} of {frames} frames",
    )


FACE = slice(22, 25)  # jaw and eyes, which nothing here moves


def _shape(
    model: BodyModel, free: Objective, start: Pose, z: Array, skin: Skin, frames: list[int], tell: Callable[[float, str], None]
) -> Array:
    """β [S] from some frames together."""
    S, n = free.shapes, z.shape[1]
    u = np.concatenate([start.shape[:S], *(z[f] for f in frames)])
    parts = [S + i * n + np.arange(n) for i in range(len(frames))]
    for round_ in range(ROUNDS):
        tell(0.4 * round_ / ROUNDS, f"shape, round {round_ + 1}")
        terms = [_term(model, free.near(z[f]), u[:S], u[part], skin, f) for f, part in zip(frames, parts, strict=True)]
        terms = [(replace(o, shape_prior=o.shape_prior / len(frames)), d) for o, d in terms]

        def energy(u: Array, terms=terms) -> float:
            return sum(o.energy(d, u[part], u[:S]) for (o, d), part in zip(terms, parts, strict=True))

        def expand(u: Array, terms=terms) -> tuple[float, Array, Array]:
            E, g, H = 0.0, np.zeros_like(u), np.zeros((len(u), len(u)))
            for (o, d), part in zip(terms, parts, strict=True):
                at = np.append(np.arange(S), part)
                E_1, g_1, H_1 = o.expand(d, u[part], u[:S])
                E, g[at], H[np.ix_(at, at)] = E + E_1, g[at] + g_1, H[np.ix_(at, at)] + H_1
            return E, g, H

        u = minimise(expand, energy, u, steps=STEPS).z
    return u[:S]


def _frame(model: BodyModel, free: Objective, start: Pose, z: Array, shape: Array, skin: Skin, frame: int) -> tuple[Array, Array]:
    """z [n] of a frame with the shape kept, and the median distance of matched skin before and after [2] m."""
    now = z
    before = np.median(_matched(model, free, start.shape, z, skin, frame).distance)
    for _ in range(FRAME_ROUNDS):
        objective, distance = _term(model, free.near(z), shape, now, skin, frame)
        kept = objective.frozen(shape)
        now = minimise(lambda u: kept.expand(distance, u), lambda u: kept.energy(distance, u), now, steps=STEPS).z  # noqa: B023
    return now, np.array([before, np.median(_matched(model, free, shape, now, skin, frame).distance)])


def _term(model: BodyModel, objective: Objective, shape: Array, z: Array, skin: Skin, frame: int) -> tuple[Objective, SkinDistance]:
    """The objective of points matched at this shape and pose, and their distance."""
    found = _matched(model, objective, shape, z, skin, frame)
    return objective.on_surface(model, model.faces[found.face], found.barycentric), SkinDistance(found.skin, found.normal)


def _matched(model: BodyModel, objective: Objective, shape: Array, z: Array, skin: Skin, frame: int) -> Match:
    posed = model.pose(shape, np.zeros(0), objective.pose(z), z[:3])
    return matched(*skin.at(frame), posed.vertices, model.faces)
