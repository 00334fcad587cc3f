"""The body registered to tracked skin: shape and poses that bring its surface to where skin was seen.

Keypoints from a detector are some centimetres off where clothes hide a joint or the detector errs in one way on every image; skin is
tracked to millimetres. From the keypoint fit on, points of the body closest to tracked skin are found and drawn to it in turn (iterated
closest points; Besl & McKay 1992), with the priors of the keypoint fit about its own poses: what no skin shows stays where the keypoints
put it. One shape, from a few frames together, then every frame for itself.

Limits: garments are no skin, and hair and shoes are taken for it as far as 3 cm; a person of whom little skin is seen gets little from it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.body.levenberg_marquardt import minimise
from tasks.body.model import Array, BodyModel
from tasks.body.objective import FitWeights, Objective
from tasks.body.shared_shape import shared_shape, spread
from tasks.geometry.meshes import vertex_normals
from tasks.registration.skin_distance import Match, SkinDistance, matched

USED = 500  # tracked vertices
ROUNDS, FRAME_ROUNDS = 8, 4  # of matching: for the shape, and for each frame
STEPS = 6  # of Gauss-Newton between two of them
FACE = slice(22, 25)  # jaw and eyes, which nothing here moves
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
    some = spread(enough)
    free = Objective.of(model, FitWeights(shape=FitWeights().shape / len(some)))  # the frames' objectives add up to one prior of the shape
    z = np.array([free.unknowns(pose, t) for pose, t in zip(start.pose, start.translation, strict=True)])
    shape = _shape(model, free, start.shape[: free.shapes], z, skin, some, tell)
    found, distance = z.copy(), np.full((frames, 2), np.nan)
    for f in enough:
        tell(0.4 + 0.6 * f / frames, f"frame {f}")
        found[f], distance[f] = _frame(model, free, z[f], start.shape, shape, skin, f)
    pose = np.array([free.pose(u) for u in found])
    pose[:, FACE] = start.pose[:, FACE]
    before, after = 1e3 * np.nanmedian(distance, 0)
    return Registered(
        Pose(pose, shape, start.expression, found[:, :3]),
        distance,
        f"skin lies {after:.1f} mm from the body, {before:.1f} mm before, medians of {len(enough)} of {frames} frames",
    )


def _shape(
    model: BodyModel, free: Objective, shape: Array, z: Array, skin: Skin, frames: list[int], tell: Callable[[float, str], None]
) -> Array:
    """β [S] from some frames together."""
    poses = [z[f] for f in frames]
    for round_ in range(ROUNDS):
        tell(0.4 * round_ / ROUNDS, f"shape, round {round_ + 1}")
        terms = [_term(model, free.near(z[f]), shape, pose, skin, f) for f, pose in zip(frames, poses, strict=True)]
        shape, poses = shared_shape(terms, shape, poses, steps=STEPS)
    return shape


def _frame(model: BodyModel, free: Objective, z: Array, before: Array, shape: Array, skin: Skin, frame: int) -> tuple[Array, Array]:
    """z [n] of a frame in its new shape, and the median distance of matched skin, with the shape `before` and at the end [2] m."""
    now, first = z, np.median(_matched(model, free, before, z, skin, frame).distance)
    for _ in range(FRAME_ROUNDS):
        objective, distance = _term(model, free.near(z), shape, now, skin, frame)
        kept = objective.frozen(shape)
        now = minimise(lambda u: kept.expand(distance, u), lambda u: kept.energy(distance, u), now, steps=STEPS).z  # noqa: B023
    return now, np.array([first, np.median(_matched(model, free, shape, now, skin, frame).distance)])


def _term(model: BodyModel, objective: Objective, shape: Array, z: Array, skin: Skin, frame: int) -> tuple[Objective, SkinDistance]:
    """The objective of points matched at this shape and pose, and their distance."""
    found = _matched(model, objective, shape, z, skin, frame)
    return objective.on_surface(model, model.faces[found.face], found.barycentric), SkinDistance(found.skin, found.normal)


def _matched(model: BodyModel, objective: Objective, shape: Array, z: Array, skin: Skin, frame: int) -> Match:
    posed = model.pose(shape, np.zeros(0), objective.pose(z), z[:3])
    return matched(*skin.at(frame), posed.vertices, model.faces)
