"""Motions in BVH files (Biovision hierarchy), read as rotations, resampled by time and brought onto a body in SMPL-X joint layout.

A joint's world transform is that of its parent times (offset + translation channels, product of the rotation channels in the order in
which the file names them); angles are degrees about moving axes. The order differs from joint to joint in some CMU files, whose lengths
are not metres either: `CMU_UNIT` (1/0.45 inch) turns them into metres. Joint names follow no standard; `CMU_JOINTS` is the table for
files made from the CMU database. Retargeting carries bone directions, not lengths: twist about a bone is kept relative to the rest pose.
"""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tasks.capture.demo.motion import Motion, local_rotations
from tasks.geometry.faults import BadInput, Fault
from tasks.geometry.rotations import rotation_between

Array = NDArray[np.float64]

LONGEST = 1e6  # in units of the file: beyond any skeleton, angle or path
CMU_UNIT = 2.54 / 100 / 0.45  # [m] of one unit of length in CMU files

# joint of the body model -> (joint of the file that gives its rotation, child that gives its bone's direction there, child in the model)
CMU_JOINTS: dict[int, tuple[str, str | None, int | None]] = {
    0: ("Hips", None, None),
    1: ("LeftHip", "LeftKnee", 4),
    2: ("RightHip", "RightKnee", 5),
    3: ("lowerback", None, None),
    4: ("LeftKnee", "LeftAnkle", 7),
    5: ("RightKnee", "RightAnkle", 8),
    6: ("Chest", None, None),
    7: ("LeftAnkle", "LeftToe", 10),
    8: ("RightAnkle", "RightToe", 11),
    9: ("Chest2", None, None),
    12: ("Neck", None, None),
    13: ("LeftCollar", None, None),
    14: ("RightCollar", None, None),
    15: ("Head", None, None),
    16: ("LeftShoulder", "LeftElbow", 18),
    17: ("RightShoulder", "RightElbow", 19),
    18: ("LeftElbow", "LeftWrist", 20),
    19: ("RightElbow", "RightWrist", 21),
    20: ("LeftWrist", "LFingers", 28),
    21: ("RightWrist", "RFingers", 43),
}


@dataclass(frozen=True)
class Bvh:
    """A skeleton and its motion.

    names [joint], parents [joint] (-1 for the root), offsets [joint, 3] m from the parent, tips [joint, 3] m (offset of the end site, zero
    where the joint has children), rotations [time, joint, 3, 3] against the parent, translation [time, 3] m of the root, fps.
    """

    names: tuple[str, ...]
    parents: NDArray[np.int32]
    offsets: Array
    tips: Array
    rotations: Array
    translation: Array
    fps: float

    def __len__(self) -> int:
        return len(self.rotations)


def read_bvh(path: str | Path, *, unit: float = CMU_UNIT) -> Bvh:
    """Read a BVH file whose unit of length is `unit` metres. Raises `BadInput` on a file that is absent, cut short or of another kind."""
    try:
        words = Path(path).read_text(errors="replace").split()  # white space only: mixed line endings do no harm
    except OSError as error:
        raise BadInput([Fault(str(path), f"it cannot be read ({error.strerror})", "Give a BVH file.")]) from None
    if words[:1] != ["HIERARCHY"] or "MOTION" not in words:
        raise BadInput([Fault(str(path), "no HIERARCHY followed by MOTION", "Give a BVH file.")])
    start = words.index("MOTION")
    try:
        names, parents, offsets, tips, channels = _hierarchy(words[1:start])
        values, fps = _motion(words[start + 1 :], sum(map(len, channels)), str(path))
        rotations, translation = _transforms(values, channels)
        if not np.isfinite([*offsets, *tips]).all() or np.abs([*offsets, *tips]).max() > LONGEST:
            raise ValueError("a bone of impossible length")
    except (ValueError, IndexError, ZeroDivisionError) as error:
        if isinstance(error, BadInput):
            raise
        raise BadInput([Fault(str(path), f"is not understood ({error})", "Export the motion again.")]) from None
    return Bvh(
        tuple(names), np.array(parents, np.int32), unit * np.array(offsets), unit * np.array(tips), rotations, unit * translation, fps
    )


def joint_positions(bvh: Bvh) -> tuple[Array, Array]:
    """World positions [time, joint, 3] m and rotations [time, joint, 3, 3] of all joints."""
    x, G = np.empty((*bvh.rotations.shape[:2], 3)), np.empty_like(bvh.rotations)
    for j, parent in enumerate(bvh.parents):
        if parent < 0:
            x[:, j], G[:, j] = bvh.offsets[j] + bvh.translation, bvh.rotations[:, j]
        else:
            x[:, j] = x[:, parent] + G[:, parent] @ bvh.offsets[j]
            G[:, j] = G[:, parent] @ bvh.rotations[:, j]
    return x, G


def resample(bvh: Bvh, fps: float) -> Bvh:
    """The same motion sampled every 1/fps seconds over the same span: spherical interpolation of rotations, linear of the root."""
    from scipy.spatial.transform import Rotation, Slerp

    if len(bvh) == 1:  # nothing lies between
        return replace(bvh, fps=fps)
    have = np.arange(len(bvh)) / bvh.fps
    want = np.arange(int(np.floor(have[-1] * fps + 1e-9)) + 1) / fps
    want = np.minimum(want, have[-1])
    rotations = np.stack([Slerp(have, Rotation.from_matrix(R))(want).as_matrix() for R in np.moveaxis(bvh.rotations, 1, 0)], 1)
    translation = np.stack([np.interp(want, have, column) for column in bvh.translation.T], 1)
    return replace(bvh, rotations=rotations, translation=translation, fps=fps)


def retarget(
    bvh: Bvh,
    joints_rest: Array,
    parents: NDArray[np.int32],
    *,
    table: dict[int, tuple[str, str | None, int | None]] = CMU_JOINTS,
) -> Motion:
    """The motion on a body with rest joints [joint, 3] m and parents [joint].

    World rotation of joint j: G_j = G_b A_j, where b is its joint in the file and A_j the smallest rotation from the bone's direction in
    the body's rest pose to that in the file's. The root's path is scaled by the ratio of hip heights (standing on straight legs).
    """
    missing = sorted({name for entry in table.values() for name in entry[:2] if name} - set(bvh.names))
    if missing:
        raise BadInput([Fault("BVH joints", f"no joints named {', '.join(missing)}", "Pass the name table of this rig.")])
    _, G_file = joint_positions(bvh)
    G = np.empty((len(bvh), len(parents), 3, 3))
    for j, parent in enumerate(parents):
        if j in table:
            b, child, model_child = table[j]
            A = np.eye(3) if child is None else rotation_between(joints_rest[model_child] - joints_rest[j], _rest_direction(bvh, b, child))
            G[:, j] = G_file[:, bvh.names.index(b)] @ A
        else:
            G[:, j] = G[:, parent]
    scale = _leg_length(joints_rest[[1, 4, 7]]) / _leg_length(_rest_positions(bvh)[[bvh.names.index(table[j][0]) for j in (1, 4, 7)]])
    return Motion(local_rotations(G, parents), scale * (bvh.offsets[0] + bvh.translation) - joints_rest[0], bvh.fps)


def _hierarchy(words: list[str]) -> tuple[list[str], list[int], list[list[float]], list[list[float]], list[list[str]]]:
    names: list[str] = []
    parents, offsets, tips, channels, stack = [], [], [], [], []
    at_end_site = False
    i = 0
    while i < len(words):
        word = words[i]
        if word in ("ROOT", "JOINT"):
            stack.append(len(names))
            parents.append(stack[-2] if len(stack) > 1 else -1)
            names.append(words[i + 1])
            offsets.append([0.0] * 3)
            tips.append([0.0] * 3)
            channels.append([])
            i += 1
        elif word == "End":
            at_end_site = True
            i += 1
        elif word == "OFFSET":
            (tips if at_end_site else offsets)[stack[-1]] = [float(w) for w in words[i + 1 : i + 4]]
            i += 3
        elif word == "CHANNELS":
            count = int(words[i + 1])
            channels[stack[-1]] = words[i + 2 : i + 2 + count]
            i += 1 + count
        elif word == "}":
            if not at_end_site:
                stack.pop()
            at_end_site = False
        i += 1
    return names, parents, offsets, tips, channels


def _motion(words: list[str], width: int, where: str) -> tuple[Array, float]:
    header = re.match(r"Frames: (\d+) Frame Time: (\S+) ?", " ".join(words[:5]))
    if header is None:
        raise BadInput([Fault(where, "no 'Frames:' and 'Frame Time:' after MOTION", "Give a complete BVH file.")])
    frames, values = int(header[1]), np.array(words[5:], float)
    if not (np.abs(values) < LONGEST).all():
        raise BadInput([Fault(where, "values that are not finite or far too large", "Export the motion again.")])
    frame_time = float(header[2])
    if not 1 / LONGEST < frame_time < LONGEST:
        raise BadInput([Fault(where, f"a frame time of {header[2]} s", "Export the motion again.")])
    if not frames or len(values) != frames * width:
        raise BadInput(
            [Fault(where, f"{len(values)} values for {frames} frames of {width} channels", "The file was cut short; fetch it again.")]
        )
    return values.reshape(frames, width), 1 / frame_time


def _transforms(values: Array, channels: list[list[str]]) -> tuple[Array, Array]:
    from scipy.spatial.transform import Rotation

    rotations = np.broadcast_to(np.eye(3), (len(values), len(channels), 3, 3)).copy()
    translation = np.zeros((len(values), 3))
    at = 0
    for j, names in enumerate(channels):
        block = values[:, at : at + len(names)]
        at += len(names)
        turns = [c for c, name in enumerate(names) if name.endswith("rotation")]
        if turns:
            order = "".join(names[c][0] for c in turns)  # upper case: about moving axes, in the order of the file
            rotations[:, j] = Rotation.from_euler(order, block[:, turns], degrees=True).as_matrix()
        if j == 0:
            for c, name in enumerate(names):
                if name.endswith("position"):
                    translation[:, "XYZ".index(name[0])] = block[:, c]
    return rotations, translation


def _rest_positions(bvh: Bvh) -> Array:
    x = np.zeros_like(bvh.offsets)
    for j, parent in enumerate(bvh.parents):
        x[j] = bvh.offsets[j] + (x[parent] if parent >= 0 else 0)
    return x


def _rest_direction(bvh: Bvh, joint: str, child: str) -> Array:
    x = _rest_positions(bvh)
    return x[bvh.names.index(child)] - x[bvh.names.index(joint)]


def _leg_length(hip_knee_ankle: Array) -> float:
    return float(np.linalg.norm(np.diff(hip_knee_ankle, axis=0), axis=1).sum())
