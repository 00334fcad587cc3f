"""The 133 keypoints of COCO-WholeBody: names, order, skeleton, mirror table, and where they lie on an SMPL-X body.

    0-16 body · 17-22 feet · 23-90 face (iBUG 68) · 91-111 left hand · 112-132 right hand

Source: Jin et al., "Whole-Body Human Pose Estimation in the Wild" (2020); smplx's own map from joints to OpenPose keypoints.
DWPose itself gives these 133; many of its wrappers reorder the body to OpenPose-18 and add a neck, which makes 134: `FROM_OPENPOSE` undoes
it. Limits: hips and shoulders are SMPL-X joint centres, annotators click some centimetres further out; the facial contour stays on the jaw.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.body.model import Array, BodyModel
from tasks.body.skeleton import JOINT

BODY = [
    "nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist",
    "right_wrist", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
]  # fmt: skip
FEET = [f"{side}_{part}" for side in ("left", "right") for part in ("big_toe", "small_toe", "heel")]
FACE = [f"face_{i}" for i in range(68)]
FINGERS = ("thumb", "index", "middle", "ring", "pinky")
HANDS = [
    f"{side}_hand_{part}" for side in ("left", "right") for part in ("wrist", *(f"{finger}{i}" for finger in FINGERS for i in (1, 2, 3, 4)))
]
NAMES: tuple[str, ...] = (*BODY, *FEET, *FACE, *HANDS)
KEYPOINT = {name: k for k, name in enumerate(NAMES)}
BODY_AND_FEET, FACE_68, LEFT_HAND, RIGHT_HAND = np.arange(23), np.arange(23, 91), np.arange(91, 112), np.arange(112, 133)

_LIMBS = [
    "left_ankle-left_knee", "left_knee-left_hip", "right_ankle-right_knee", "right_knee-right_hip", "left_hip-right_hip",
    "left_shoulder-left_hip", "right_shoulder-right_hip", "left_shoulder-right_shoulder", "left_shoulder-left_elbow",
    "right_shoulder-right_elbow", "left_elbow-left_wrist", "right_elbow-right_wrist", "left_eye-right_eye", "nose-left_eye",
    "nose-right_eye", "left_eye-left_ear", "right_eye-right_ear", "left_ear-left_shoulder", "right_ear-right_shoulder",
    "left_ankle-left_big_toe", "left_ankle-left_small_toe", "left_ankle-left_heel", "right_ankle-right_big_toe",
    "right_ankle-right_small_toe", "right_ankle-right_heel",
]  # fmt: skip
LIMBS = np.array(
    [[KEYPOINT[name] for name in limb.split("-")] for limb in _LIMBS]
    + [[wrist if i == 1 else wrist + 4 * f + i - 1, wrist + 4 * f + i] for wrist in (91, 112) for f in range(5) for i in (1, 2, 3, 4)]
)  # [limb, 2] keypoints to join in a drawing
_FACE_FLIP = [
    *range(16, -1, -1), *range(26, 16, -1), *range(27, 31), *range(35, 30, -1), 45, 44, 43, 42, 47, 46, 39, 38, 37, 36, 41, 40,
    *range(54, 47, -1), *range(59, 54, -1), *range(64, 59, -1), *range(67, 64, -1),
]  # fmt: skip
FLIP = np.array(
    [KEYPOINT[name.replace("left", "L").replace("right", "left").replace("L", "right")] for name in (*BODY, *FEET)]
    + [23 + i for i in _FACE_FLIP]
    + [*RIGHT_HAND, *LEFT_HAND]
)  # keypoint k of a mirrored image is keypoint FLIP[k] of the original

# OpenPose-18 order: nose, neck, right arm, left arm, right leg, left leg, eyes, ears
_OPENPOSE_18 = (0, -1, 6, 8, 10, 5, 7, 9, 12, 14, 16, 11, 13, 15, 2, 1, 4, 3)
FROM_OPENPOSE = np.array([_OPENPOSE_18.index(k) for k in range(17)] + [*range(18, 134)])
"""keypoints133 = keypoints134[FROM_OPENPOSE]: drops the neck (index 1 of 134) and restores COCO's body order."""

_VERTEX = {"nose": "nose"} | {
    f"{side}_{part}": name
    for side, s in (("left", "l"), ("right", "r"))
    for part, name in {
        "eye": f"{s}eye", "ear": f"{s}ear",
        "big_toe": f"{s.upper()}BigToe", "small_toe": f"{s.upper()}SmallToe", "heel": f"{s.upper()}Heel",
        **{f"hand_{finger}4": f"{s}{finger}" for finger in FINGERS},
    }.items()
}  # fmt: skip


@dataclass(frozen=True)
class Placement:
    """Each keypoint as a joint or a point of the surface: joint [133] (−1: on the surface); vertices [133,3] and their shares [133,3]."""

    joint: NDArray[np.int64]
    vertices: NDArray[np.int64]
    barycentric: Array


def placement(model: BodyModel) -> Placement:
    """Where the 133 keypoints lie on a model."""
    joint = np.full(len(NAMES), -1)
    vertices, barycentric = np.zeros((len(NAMES), 3), dtype=np.int64), np.tile([1.0, 0.0, 0.0], (len(NAMES), 1))
    for k, name in enumerate(NAMES):
        if name in _VERTEX:
            vertices[k] = model.vertex_ids[_VERTEX[name]]
        elif not name.startswith("face"):
            joint[k] = JOINT[name.replace("hand_", "")]
    vertices[FACE_68], barycentric[FACE_68] = model.faces[model.landmark_faces], model.landmark_barycentric
    return Placement(joint, vertices, barycentric)


def keypoints133(model: BodyModel, vertices: Array, joints: Array) -> Array:
    """Keypoints [..., 133, 3] m of posed vertices [..., V, 3] and joints [..., 55, 3]."""
    place = placement(model)
    on_surface = np.einsum("...kcd,kc->...kd", vertices[..., place.vertices, :], place.barycentric)
    return np.where(place.joint[:, None] >= 0, joints[..., place.joint, :], on_surface)
