"""A first pose from keypoints seen by several cameras: robust triangulation, then each bone turned to where it was seen.

The pelvis, the head, hands and feet take the rotation that best carries their rest points to the seen ones (Kabsch 1976); a limb takes the
direction of its bone and, when it is bent, the plane of the bend, so that elbows and knees bend about their hinges. Left and right are told
apart by name, so a body facing the wrong way cannot arise.
Limits: shape is not fitted here; joints without seen children keep their rest rotation; no frame is used but this one.
"""

import itertools

import numpy as np
from numpy.typing import NDArray

from tasks.body.model import Array
from tasks.body.skeleton import JOINT_NAMES, PARENTS
from tasks.body.wholebody import KEYPOINT
from tasks.geometry.cameras import Cameras, project, triangulate
from tasks.geometry.rotations import axis_angle_from_matrix, rotation_between

AGREEMENT = 0.015  # of the image's long side: how far apart projection and detection of one point may lie
MAX_PAIRS = 60
BENT = 0.25  # sine of the bend from which its plane is trusted
X, Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
LIMBS = {  # joint: (keypoint at its far end, keypoint beyond, axis in the T-pose about which the beyond bends)
    "left_shoulder": ("left_elbow", "left_wrist", -Y),
    "right_shoulder": ("right_elbow", "right_wrist", Y),
    "left_elbow": ("left_wrist", None, -Y),
    "right_elbow": ("right_wrist", None, Y),
    "left_hip": ("left_knee", "left_ankle", X),
    "right_hip": ("right_knee", "right_ankle", X),
    "left_knee": ("left_ankle", None, X),
    "right_knee": ("right_ankle", None, X),
}
RIGID = {  # joint: keypoints that move with it as one piece
    "pelvis": ("left_hip", "right_hip", "left_shoulder", "right_shoulder"),
    "head": ("nose", "left_eye", "right_eye", "left_ear", "right_ear"),
    "left_ankle": ("left_ankle", "left_big_toe", "left_small_toe", "left_heel"),
    "right_ankle": ("right_ankle", "right_big_toe", "right_small_toe", "right_heel"),
    "left_wrist": ("left_hand_wrist", "left_hand_index1", "left_hand_middle1", "left_hand_pinky1"),
    "right_wrist": ("right_hand_wrist", "right_hand_index1", "right_hand_middle1", "right_hand_pinky1"),
}


def robust_points(cameras: Cameras, uv: Array, score: Array, *, seed: int = 0) -> Array:
    """Points [q,3] m from pixels uv [camera,q,2] with scores [camera,q] ≥ 0; NaN where no two cameras agree.

    Every pair of cameras (at most 60, drawn by `seed`) proposes a point; the proposal that most cameras agree with is refined on those.
    """
    tolerance = AGREEMENT * cameras.size.max(axis=1)[:, None]
    pairs = np.array(list(itertools.combinations(range(len(cameras)), 2)))
    if len(pairs) > MAX_PAIRS:
        pairs = np.random.default_rng(seed).permutation(pairs)[:MAX_PAIRS]
    best, votes = np.zeros_like(score), np.zeros(score.shape[1])
    for pair in pairs:
        x, _ = triangulate(cameras.subset(pair), uv[pair], score[pair])
        agree = _agreement(cameras, x, uv, tolerance) * score
        better = agree.sum(axis=0) > votes
        best[:, better], votes[better] = agree[:, better], agree.sum(axis=0)[better]
    best[:, (best > 0).sum(axis=0) < 2] = 0
    return triangulate(cameras, uv, best)[0]


def initial_pose(rest: Array, rest_joints: Array, seen: Array) -> tuple[Array, Array]:
    """pose [55,3] rad and translation [3] m that bring rest keypoints [133,3] near the seen ones [133,3] m (NaN where not seen).

    Where hips or shoulders are not seen the body stays upright at rest, at the centre of what is seen; at the origin where nothing is.
    """
    world = np.tile(np.eye(3), (len(JOINT_NAMES), 1, 1))
    pose = np.zeros((len(JOINT_NAMES), 3))
    for j, (name, parent) in enumerate(zip(JOINT_NAMES, PARENTS, strict=True)):
        above = world[parent] if parent >= 0 else np.eye(3)
        world[j] = _bone(name, rest, seen, above)
        pose[j] = axis_angle_from_matrix(above.T @ world[j])
    anchor = [KEYPOINT[name] for name in RIGID["pelvis"]]
    anchor = anchor if np.isfinite(seen[anchor]).all() else np.flatnonzero(np.isfinite(seen).all(axis=1))
    pelvis = rest_joints[0]
    translation = (seen[anchor] - (rest[anchor] - pelvis) @ world[0].T - pelvis).mean(axis=0) if len(anchor) else np.zeros(3)
    return pose, translation


def _bone(name: str, rest: Array, seen: Array, above: Array) -> Array:
    """World rotation of a bone, given that of the bone above it."""
    if name in RIGID:
        points = np.array([KEYPOINT[point] for point in RIGID[name]])
        points = points[np.isfinite(seen[points]).all(axis=1)]
        return _kabsch(rest[points], seen[points]) if len(points) >= 3 else above
    if name not in LIMBS:
        return above
    far, beyond, hinge = LIMBS[name]
    was, now = rest[KEYPOINT[far]] - rest[KEYPOINT[name]], seen[KEYPOINT[far]] - seen[KEYPOINT[name]]
    if not np.isfinite(now).all():
        return above
    if beyond is not None:
        after = seen[KEYPOINT[beyond]] - seen[KEYPOINT[far]]
        normal = np.cross(now, after)
        if np.linalg.norm(normal) > BENT * np.linalg.norm(now) * np.linalg.norm(after):  # False for NaN
            return _frame(now, normal) @ _frame(was, hinge).T
    return rotation_between(above @ was, now) @ above


def _kabsch(a: Array, b: Array) -> Array:
    U, _, Vt = np.linalg.svd((b - b.mean(axis=0)).T @ (a - a.mean(axis=0)))
    return U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt


def _frame(along: Array, normal: Array) -> Array:
    a = along / np.linalg.norm(along)
    n = normal - a * (a @ normal)
    n = n / np.linalg.norm(n)
    return np.stack([a, n, np.cross(a, n)], axis=1)


def _agreement(cameras: Cameras, x: Array, uv: Array, tolerance: Array) -> NDArray[np.bool_]:
    at, depth = project(cameras, x)
    with np.errstate(invalid="ignore"):
        return (np.linalg.norm(at - uv, axis=-1) < tolerance) & (depth > 0)
