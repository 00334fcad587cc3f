"""SMPL-X fitted to keypoints in many views: equations 1-3 of the PhysAvatar supplement (A.1).

    L = λ_b Σ d(body) + λ_h Σ d(hands) + λ_m‖m_h‖² + λ_l‖θ_b‖² + λ_f‖θ_f‖² + λ_β‖β‖² + λ_ψ‖ψ‖²

One shape for the whole sequence, fitted jointly on a few frames and then frozen. The first frame in which cameras agree on a point starts
from triangulated points, those after it from the one before, those before it from the one after. Terms in `objective.py`, image distance in
`reprojection.py`, decisions in README.md.
Limits: θ_b is the axis-angle pose drawn to the rest pose, not a VPoser latent (its licence forbids shipping it): what no camera sees tends
to rest. Twist of a limb about its axis is only seen through the next joint. One person, metric cameras, no contact with the ground, no
smoothing over time.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.body.initial_pose import initial_pose, robust_points
from tasks.body.keypoint_body import keypoint_body
from tasks.body.levenberg_marquardt import Minimum, minimise
from tasks.body.model import JOINTS, Array, BodyModel, Posed
from tasks.body.objective import FitWeights, Objective
from tasks.body.reprojection import Sight
from tasks.body.shared_shape import shared_shape, spread
from tasks.body.wholebody import NAMES, keypoints133
from tasks.geometry.cameras import Cameras, project
from tasks.geometry.faults import BadInput, Fault, refuse

SUPPLEMENT = FitWeights()


@dataclass(frozen=True)
class BodyMotion:
    """pose [frame,55,3] rad; shape [S]; expression [frame,E]; translation [frame,3] m; vertices [frame,V,3] and joints [frame,55,3] m;
    transforms [frame,55,4,4] from rest to world; reprojection_px [frame,camera,133] (NaN where nothing was detected); converged [frame];
    `ending` says how the fit went. scale multiplies everything after translation, as in PhysAvatar's fits; metric cameras leave it at 1."""

    pose: Array
    shape: Array
    expression: Array
    translation: Array
    scale: float
    vertices: Array
    joints: Array
    transforms: Array
    reprojection_px: Array
    converged: NDArray[np.bool_]
    ending: str


def fit_sequence(
    model: BodyModel, cameras: Cameras, keypoints: Array, scores: Array, *, weights: FitWeights = SUPPLEMENT, shape: Array | None = None
) -> BodyMotion:
    """Fit all frames. keypoints [frame,camera,133,2] px (NaN: not detected), scores [frame,camera,133] ≥ 0; a known shape [S] is kept.

    Raises BadInput when arrays and rig do not match, or no two cameras see a point in the same place.
    """
    refuse(_faults(cameras, keypoints, scores))
    objective = Objective.of(model, weights)
    sights = [objective.sight(cameras, uv, score) for uv, score in zip(keypoints, scores, strict=True)]

    def afresh(frame: int) -> Array | None:
        seen = robust_points(cameras, keypoints[frame], np.where(np.isfinite(keypoints[frame]).all(axis=-1), scores[frame], 0.0))
        return objective.start(*initial_pose(*_rest(model), seen)) if np.isfinite(seen).any() else None

    begin, start = _first(len(sights), afresh)
    fresh = {begin: start}
    if shape is None:
        chosen = spread([frame for frame, sight in enumerate(sights) if sight.trust.any()])
        fresh = {frame: z for frame in chosen if (z := afresh(frame)) is not None} or fresh
        shape, poses = shared_shape([(objective, sights[frame]) for frame in fresh], np.zeros(objective.shapes), list(fresh.values()))
        fresh = dict(zip(fresh, poses, strict=True))
    frozen, minima = objective.frozen(shape), {}
    for frame in (*range(begin, -1, -1), *range(begin + 1, len(sights))):
        beside = minima.get(frame - 1 if frame > begin else frame + 1)
        z = fresh.get(frame, start) if beside is None else frozen.short_way(beside.z)
        minima[frame] = _fit_frame(frozen, sights[frame], z, lambda frame=frame: afresh(frame))
    return _motion(model, frozen, cameras, keypoints, shape, [minima[frame] for frame in range(len(sights))])


def _first(count: int, afresh: Callable[[int], Array | None]) -> tuple[int, Array]:
    """The first of `count` frames that can be started afresh, and its start. Raises BadInput where there is none."""
    for frame in range(count):
        if (start := afresh(frame)) is not None:
            return frame, start
    raise BadInput(
        [Fault("keypoints", "no two cameras see a point in the same place", "Check the calibration and the order of the cameras.")]
    )


def _fit_frame(objective: Objective, sight: Sight, z: Array, afresh: Callable[[], Array | None]) -> Minimum:
    if not sight.trust.any():
        return Minimum(z, 0.0, 0, False, "nothing was seen: pose of the frame beside it")
    best = _descend(objective, sight, z)
    if (
        not best.converged and (start := afresh()) is not None
    ):  # after a jump the way from the frame beside it is long and may lead elsewhere
        best = min(best, _descend(objective, sight, start), key=lambda minimum: minimum.energy)
    return best


def _descend(objective: Objective, sight: Sight, z: Array) -> Minimum:
    return minimise(lambda z: objective.expand(sight, z), lambda z: objective.energy(sight, z), z)


def _rest(model: BodyModel) -> tuple[Array, Array]:
    body = keypoint_body(model)
    return body.at(np.zeros(body.joints_by_shape.shape[2]), np.zeros((JOINTS, 3)), np.zeros(3)).p, body.joints


def _motion(model: BodyModel, objective: Objective, cameras: Cameras, keypoints: Array, shape: Array, minima: list[Minimum]) -> BodyMotion:
    pose = np.array([objective.pose(minimum.z) for minimum in minima])
    expression = np.zeros((len(minima), model.expression_directions.shape[2]))
    if objective.expression(minima[0].z).size:
        expression = np.array([objective.expression(minimum.z) for minimum in minima])
    translation = np.array([minimum.z[:3] for minimum in minima])
    posed = pose_sequence(model, shape, expression, pose, translation)
    return BodyMotion(
        pose, shape, expression, translation, 1.0, posed.vertices, posed.joints, posed.transforms,
        reprojection_px=reprojected(model, cameras, keypoints, posed),
        converged=np.array([minimum.converged for minimum in minima]),
        ending=_ending(minima),
    )  # fmt: skip


def pose_sequence(model: BodyModel, shape: Array, expression: Array, pose: Array, translation: Array) -> Posed:
    """The body in every frame, one after the other: all at once would need gigabytes."""
    each = [model.pose(shape, *frame) for frame in zip(expression, pose, translation, strict=True)]
    return Posed(*(np.array([getattr(frame, name) for frame in each]) for name in ("vertices", "joints", "transforms")))


def reprojected(model: BodyModel, cameras: Cameras, keypoints: Array, posed: Posed) -> Array:
    """Distance [frame, camera, 133] px of the body's keypoints from detected ones [frame, camera, 133, 2] px, NaN where there is none."""
    uv = np.moveaxis(project(cameras, keypoints133(model, posed.vertices, posed.joints))[0], 0, 1)
    return np.linalg.norm(uv - keypoints, axis=-1)


def _ending(minima: list[Minimum]) -> str:
    steps = sum(minimum.steps for minimum in minima)
    summary = f"{sum(minimum.converged for minimum in minima)} of {len(minima)} frames converged, {steps / len(minima):.1f} steps per frame"
    return "; ".join([summary, *(f"frame {i}: {minimum.ending}" for i, minimum in enumerate(minima) if not minimum.converged)])


def _faults(cameras: Cameras, keypoints: Array, scores: Array) -> list[Fault]:
    expected = (len(cameras), len(NAMES))
    if keypoints.shape[1:] != (*expected, 2) or scores.shape != keypoints.shape[:3]:
        found = f"keypoints {keypoints.shape}, scores {scores.shape}"
        return [Fault("keypoints", found, f"Expected [frame, {expected[0]}, {expected[1]}, 2] and [frame, {expected[0]}, {expected[1]}].")]
    faults = []
    if not (scores >= 0).all():
        faults.append(
            Fault("scores", f"{int((~(scores >= 0)).sum())} values are negative or NaN", "Use 0 for points that were not detected.")
        )
    seen = np.isfinite(keypoints).all(axis=-1) & (scores > 0)
    if not (seen.sum(axis=1) >= 2).any():
        faults.append(
            Fault("keypoints", "no point is seen by two cameras", "Check detection, and that cameras and keypoints are in the same order.")
        )
    return faults
