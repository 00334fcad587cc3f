"""The body registered to tracked skin: shape and poses that bring its surface to where skin was seen.

Keypoints from a detector are some centimetres off where clothes hide a joint or the detector errs in one way on every image; skin is
tracked to millimetres. From the keypoint fit on, points of the body closest to tracked skin are found and drawn to it in turn (iterated
closest points; Besl & McKay 1992), with the priors of the keypoint fit about its own poses: what nothing shows stays where the keypoints
put it. One shape, from the skin of a few frames together; then the first frame from its skin; then every frame for itself, from its skin and
the cloth that clung to the body in the first (`clinging_cloth.py`).

Limits: hair and shoes are taken for skin as far as 3 cm; a person of whom little skin is seen gets little from it.
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
from tasks.registration.clinging_cloth import LEAVES, NO_CLOTH, Clinging, clinging
from tasks.registration.skin_distance import Match, SkinDistance, Together, evenly, matched
from tasks.side_by_side import side_by_side

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
        own = evenly(self.index[self.seen[frame, self.index]])
        x = self.vertices[frame]
        known = self.faces[np.isfinite(x).all(-1)[self.faces].all(1)]
        return x[own], vertex_normals(x, known)[own]


@dataclass(frozen=True)
class Registered:
    """The pose, the median distance [frame, 2] m of matched skin from the body before and after, and how it ended."""

    found: Pose
    distance: Array
    ending: str


def register(
    model: BodyModel,
    start: Pose,
    skin: Skin,
    garment_faces: NDArray[np.int32],
    tell: Callable[[float, str], None] = lambda share, text: None,
    *,
    at_once: int = 1,
) -> Registered:
    """Shape and poses that tracked skin and clinging cloth ask for, from those that keypoints gave; garment_faces [G, 3] of the tracked
    surface. at_once: frames that are fitted side by side, each in a thread of its own.
    """
    frames = len(start.pose)
    enough = [f for f in range(frames) if skin.seen[f, skin.index].sum() >= FEWEST]
    if not enough:
        return Registered(start, np.full((frames, 2), np.nan), "too little skin was tracked: as keypoints had it")
    some = spread(enough)
    free = Objective.of(model, FitWeights(shape=FitWeights().shape / len(some)))  # the frames' objectives add up to one prior of the shape
    z = np.array([free.unknowns(pose, t) for pose, t in zip(start.pose, start.translation, strict=True)])
    shape = _shape(model, free, start.shape[: free.shapes], z, skin, some, tell)
    first = enough[0]
    body = _posed(model, free, shape, _frame(model, free, z[first], shape, skin, NO_CLOTH, first))
    cloth = clinging(skin.vertices[first], garment_faces, body, model.faces)
    found, distance = z.copy(), np.full((frames, 2), np.nan)

    def fitted(f: int) -> None:
        tell(0.4 + 0.6 * f / frames, f"frame {f}")
        found[f] = _frame(model, free, z[f], shape, skin, cloth, f)
        distance[f] = [_from_skin(model, free, β, u, skin, f) for β, u in ((start.shape, z[f]), (shape, found[f]))]

    side_by_side(fitted, enough, at_once)
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


def _frame(model: BodyModel, free: Objective, z: Array, shape: Array, skin: Skin, cloth: Clinging, frame: int) -> Array:
    """z [n] of a frame in its new shape."""
    now = z
    for _ in range(FRAME_ROUNDS):
        objective, distance = _term(model, free.near(z), shape, now, skin, frame, cloth)
        kept = objective.frozen(shape)
        now = minimise(lambda u: kept.expand(distance, u), lambda u: kept.energy(distance, u), now, steps=STEPS).z  # noqa: B023
    return now


def _term(
    model: BodyModel, objective: Objective, shape: Array, z: Array, skin: Skin, frame: int, cloth: Clinging = NO_CLOTH
) -> tuple[Objective, Together]:
    """The objective of points matched at this shape and pose, and their distance."""
    found, surface = _matched(model, objective, shape, z, skin, frame), skin.vertices[frame]
    own = cloth.at(surface, skin.seen[frame])
    under, normal = own.skin(surface, _posed(model, objective, shape, z), model.faces)
    corners = np.concatenate([model.faces[found.face], own.corners])
    points = objective.on_surface(model, corners, np.concatenate([found.barycentric, own.barycentric]))
    return points, Together((SkinDistance(found.skin, found.normal), SkinDistance(under, normal, LEAVES)))


def _matched(model: BodyModel, objective: Objective, shape: Array, z: Array, skin: Skin, frame: int) -> Match:
    return matched(*skin.at(frame), _posed(model, objective, shape, z), model.faces)


def _from_skin(model: BodyModel, free: Objective, shape: Array, z: Array, skin: Skin, frame: int) -> float:
    """Median distance [m] of matched skin."""
    return float(np.median(_matched(model, free, shape, z, skin, frame).distance))


def _posed(model: BodyModel, objective: Objective, shape: Array, z: Array) -> Array:
    """Vertices [V, 3] m."""
    return model.pose(shape, np.zeros(0), objective.pose(z), z[:3]).vertices
