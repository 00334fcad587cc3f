"""A body motion: joint angles and root translation over time, and the short dance that the demo actor performs.

The dance is written in world directions (pelvis heading, feet on the floor, direction of each upper arm) and turned into joint angles
against the rest joints, so that it does not depend on the rest pose of the body (T or A). Legs are solved so that the standing
foot does not slide (`limbs`). Everything oscillates with one period; an envelope brings the motion in from standing still with zero
velocity and acceleration, because the garments have settled on the body as it stands before the first frame.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.capture.demo.limbs import two_bone_limb
from tasks.geometry.rotations import axis_angle_from_matrix, matrix_from_axis_angle, rotation_between

Array = NDArray[np.float64]

PERIOD = 1.2  # [s] of one sway to the left and one to the right
ATTACK = 0.3  # [s] from standing still to full motion
PELVIS, SPINE, NECK, HEAD = 0, (3, 6, 9), 12, 15
HIP, KNEE, ANKLE, TOE = (1, 2), (4, 5), (7, 8), (10, 11)
SHOULDER, ELBOW, WRIST = (16, 17), (18, 19), (20, 21)
STANCE = 0.12  # [m] of each ankle from the middle
SIDE = (1.0, -1.0)  # the left of the body is +x
X, Y, Z = np.eye(3)


@dataclass(frozen=True)
class Motion:
    """pose [time, joint, 3] axis-angle rad in the order of the body model, translation [time, 3] m, frames per second."""

    pose: Array
    translation: Array
    fps: float

    def __len__(self) -> int:
        return len(self.pose)


def dance(joints_rest: Array, parents: NDArray[np.int32], *, sole: float, frames: int, fps: float = 25.0, energy: float = 1.0) -> Motion:
    """Steps on the spot with hip sway, half turns and an arm lift; joints_rest [joint, 3] m of the body at rest, parents [joint].

    `sole` [m] is the height of the soles at rest; they come to stand on the floor y = 0. `energy` scales every amplitude (0 stands
    still, 1 is lively, above 1.5 the feet may not reach the floor). After `ATTACK` seconds the motion repeats every `PERIOD` seconds.
    """
    t = np.arange(frames) / fps
    ω = 2 * np.pi / PERIOD
    a = energy * envelope(t)
    sway, turn, bounce = np.sin(ω * t), np.sin(ω * t - 0.6), 1 - np.cos(2 * ω * t)

    root = np.stack([a * 0.045 * sway, -0.02 - a * 0.012 * bounce, a * 0.02 * np.sin(ω * t + 1.0)], 1)
    G = np.broadcast_to(np.eye(3), (frames, len(parents), 3, 3)).copy()
    G[:, PELVIS] = _about(Y, a * 0.42 * turn) @ _about(Z, -a * 0.09 * sway) @ _about(X, 0.02 + a * 0.04 * bounce)
    chest = _about(Y, -a * 0.10 * turn) @ _about(Z, a * 0.07 * sway)
    for share, joint in enumerate(SPINE, 1):
        G[:, joint] = _blend(chest, share / 3) @ G[:, PELVIS]
    torso = G[:, SPINE[-1]]
    G[:, NECK] = G[:, HEAD] = _about(Y, -a * 0.12 * turn) @ torso
    for k in (0, 1):
        _swing_arm(G, joints_rest, k, torso, *_arm_angles(a, sway, turn, k))
        _stand_on_leg(G, joints_rest, k, root, a * 0.055 * np.clip(-SIDE[k] * sway, 0, None) ** 2, a * 0.25 * turn)
    _inherit(G, parents)
    return Motion(local_rotations(G, parents), root - sole * Y, fps)


def envelope(t: Array) -> Array:
    """Rises from 0 to 1 over `ATTACK` with two continuous derivatives (quintic); t [...] s."""
    s = np.clip(t / ATTACK, 0, 1)
    return s**3 * (10 - 15 * s + 6 * s * s)


def local_rotations(G: Array, parents: NDArray[np.int32]) -> Array:
    """Axis-angle pose [time, joint, 3] whose world rotations are G [time, joint, 3, 3]: R_j = G_parentᵀ G_j."""
    R = G.copy()
    children = np.flatnonzero(np.asarray(parents) >= 0)
    R[:, children] = np.swapaxes(G[:, np.asarray(parents)[children]], -1, -2) @ G[:, children]
    return axis_angle_from_matrix(R)


def _arm_angles(a: Array, sway: Array, turn: Array, k: int) -> tuple[Array, Array, Array]:
    """Abduction from hanging, forward swing and elbow flexion [time] rad of arm k; the left arm is the one that lifts."""
    lift = 0.55 if k == 0 else 0.12
    return 0.80 + lift * a * (1 - 0.4 * sway), 0.10 + 0.22 * a * SIDE[k] * turn, 0.30 + 0.25 * a * (1 + SIDE[k] * sway) / 2


def _swing_arm(G: Array, joints: Array, k: int, torso: Array, abduction: Array, forward: Array, flexion: Array) -> None:
    down = np.stack([SIDE[k] * np.sin(abduction), -np.cos(abduction) * np.cos(forward), np.cos(abduction) * np.sin(forward)], 1)
    upper = np.broadcast_to(joints[ELBOW[k]] - joints[SHOULDER[k]], down.shape)
    fore = np.broadcast_to(joints[WRIST[k]] - joints[ELBOW[k]], down.shape)
    G[:, SHOULDER[k]] = torso @ rotation_between(upper, down)
    towards = matrix_from_axis_angle(-flexion[:, None] * X) @ down[..., None]  # the forearm bends forwards and up
    G[:, ELBOW[k]] = G[:, WRIST[k]] = torso @ rotation_between(fore, towards[..., 0])


def _stand_on_leg(G: Array, joints: Array, k: int, root: Array, lift: Array, heading: Array) -> None:
    stand = joints[ANKLE[k]] * (Y + Z) + STANCE * SIDE[k] * X
    ankle = stand + lift[:, None] * (Y + 0.15 * Z)
    hip = joints[PELVIS] + root + np.einsum("tij,j->ti", G[:, PELVIS], joints[HIP[k]] - joints[PELVIS])
    facing = _about(Y, heading)[..., 2]
    G[:, HIP[k]], G[:, KNEE[k]] = two_bone_limb(hip, ankle, joints[[HIP[k], KNEE[k], ANKLE[k]]], facing, rest_facing=Z)
    G[:, ANKLE[k]] = G[:, TOE[k]] = _about(X, 4.0 * lift)  # [rad/m]: the toes of a lifted foot point down


def _inherit(G: Array, parents: NDArray[np.int32]) -> None:
    """Joints that the dance does not speak of (collars, jaw, eyes, fingers) turn with their parents."""
    spoken = {PELVIS, *SPINE, NECK, HEAD, *HIP, *KNEE, *ANKLE, *TOE, *SHOULDER, *ELBOW, *WRIST}
    for joint in sorted(set(range(len(parents))) - spoken):
        G[:, joint] = G[:, parents[joint]]


def _about(axis: Array, angle: Array) -> Array:
    return matrix_from_axis_angle(np.asarray(angle)[:, None] * axis)


def _blend(R: Array, share: float) -> Array:
    return matrix_from_axis_angle(share * axis_angle_from_matrix(R))
