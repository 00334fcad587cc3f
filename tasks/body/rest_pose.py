"""Bringing a human from the pose it was modelled in (arms down and bent) into the rest pose of SMPL-X (arms along ±x, palms down).

    B = Σ_j w_j T_j,    T_j the rigid motion of bone j from the T-pose back to the modelled pose,    x_T = B⁻¹ x

so that linear blend skinning of x_T by the same T_j returns x exactly: the person looks as modelled where arms hang, which is where
actors' arms are, and pays the price of blending in the T-pose, which nobody strikes.
Source: Loper et al., "SMPL" (2015), eq. 2-4, solved for the rest pose.
"""

import numpy as np

from tasks.body.skeleton import FINGERS, JOINT_NAMES, PARENTS
from tasks.geometry.rotations import axis_angle_from_matrix, matrix_from_axis_angle, rotation_between

SIDES = {"left": 1.0, "right": -1.0}


def t_pose(x: np.ndarray, joints: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [V,3] and joints [55,3] m in the T-pose, from vertices [V,3], joints [55,3], skin weights [V,55] in the modelled pose."""
    R = _turns(joints)
    rest = np.array(joints)
    for j, parent in enumerate(PARENTS):
        if parent >= 0:
            rest[j] = rest[parent] + R[parent] @ (joints[j] - joints[parent])
    back = np.swapaxes(R, 1, 2)  # T_j x = R_jᵀ (x − rest_j) + joint_j
    B = np.einsum("vj,jab->vab", weights, back)
    shift = weights @ (joints - np.einsum("jab,jb->ja", back, rest))
    return np.linalg.solve(B, (x - shift)[..., None])[..., 0], rest


def _turns(joints: np.ndarray) -> np.ndarray:
    """World rotation [55,3,3] of each bone from the modelled pose to the T-pose: arms and hands turn, the rest stays."""
    at = {name: joints[j] for j, name in enumerate(JOINT_NAMES)}
    R = np.tile(np.eye(3), (len(JOINT_NAMES), 1, 1))
    for side, sign in SIDES.items():
        x_axis = np.array([sign, 0.0, 0.0])
        shoulder, elbow, wrist = (at[f"{side}_{part}"] for part in ("shoulder", "elbow", "wrist"))
        turn = {"shoulder": rotation_between(elbow - shoulder, x_axis), "wrist": _hand_turn(at, side, x_axis)}
        turn["elbow"] = _half_way(rotation_between(wrist - elbow, x_axis), turn["wrist"], x_axis)
        for j, name in enumerate(JOINT_NAMES):
            if name.startswith(side):
                part = name.removeprefix(f"{side}_")
                R[j] = turn.get(part, turn["wrist"] if part[:-1] in FINGERS else np.eye(3))
    return R


def _hand_turn(at: dict[str, np.ndarray], side: str, x_axis: np.ndarray) -> np.ndarray:
    """Turns the hand so that its fingers run along ±x and the line of knuckles from little to index finger along +z."""
    along = at[f"{side}_middle1"] - at[f"{side}_wrist"]
    across = at[f"{side}_index1"] - at[f"{side}_pinky1"]
    return _frame(x_axis, np.array([0.0, 0.0, 1.0])) @ _frame(along, across).T


def _frame(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    a = first / np.linalg.norm(first)
    b = second - a * (a @ second)
    b = b / np.linalg.norm(b)
    return np.stack([a, b, np.cross(a, b)], axis=1)


def _half_way(forearm: np.ndarray, hand: np.ndarray, x_axis: np.ndarray) -> np.ndarray:
    """The forearm takes half of the hand's roll about the arm, as radius over ulna does."""
    roll = axis_angle_from_matrix(hand @ forearm.T) @ x_axis
    return matrix_from_axis_angle(0.5 * roll * x_axis) @ forearm
