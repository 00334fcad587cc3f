"""The 55 joints of SMPL-X: names, order and parents (Pavlakos et al. 2019, "Expressive Body Capture", the order of its model files)."""

import numpy as np

BODY = [
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2", "left_ankle", "right_ankle", "spine3", "left_foot",
    "right_foot", "neck", "left_collar", "right_collar", "head", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow",
    "left_wrist", "right_wrist", "jaw", "left_eye", "right_eye",
]  # fmt: skip
FINGERS = ("index", "middle", "pinky", "ring", "thumb")
JOINT_NAMES: tuple[str, ...] = (*BODY, *(f"{side}_{finger}{i}" for side in ("left", "right") for finger in FINGERS for i in (1, 2, 3)))
PARENTS = np.array(
    [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 15, 15, 15]
    + [
        parent
        for wrist in (20, 21)
        for first in range(25 + 15 * (wrist - 20), 40 + 15 * (wrist - 20), 3)
        for parent in (wrist, first, first + 1)
    ]
)
JOINT = {name: j for j, name in enumerate(JOINT_NAMES)}
