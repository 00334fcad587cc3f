"""Motions that anybody can make with the garment at hand: the recorded one otherwise, and its first pose moved as a whole.

They start from the state in which the recording starts, and last as long as they are asked to, or as long as the recording lets them.
Up is +y.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from tasks.cloth.windows import Recording
from tasks.effects.effect import Motion
from tasks.geometry.rotations import matrix_from_axis_angle

Array = NDArray[np.float64]

SWAY = 0.3  # [m] from end to end
TURN = np.pi / 2  # [rad]
HZ = 1.0  # there and back


@dataclass(frozen=True)
class NextMotion:
    """said: what to do; motion [T] frames; x0 [V, 3] m and v0 [V, 3] m/s of the cloth in the first."""

    said: str
    motion: Motion
    x0: Array
    v0: Array


def next_motions(recording: Recording, x0: Array, v0: Array, frames: int, fps: float) -> list[NextMotion]:
    """All of `frames` frames, or fewer where the recording is too short for them. x0 [V, 3] m, v0 [V, 3] m/s: how the cloth starts in it."""
    motion, there = recording.motion.given_way, partial(_there_and_back, frames, fps)
    axis = x0.mean(0) * (1, 0, 1)
    half_turn = partial(_moved, turn=np.array([np.pi]), shift=np.zeros((1, 3)), axis=axis)
    found = [
        NextMotion("the same motion at half the speed", _at_speed(motion, 0.5, frames), x0, 0.5 * v0),
        NextMotion("the same motion at twice the speed", _at_speed(motion, 2.0, frames), x0, 2.0 * v0),
        NextMotion(
            "the same motion, facing the other way",
            _each(_at_speed(motion, 1.0, frames), half_turn),
            half_turn(x0[None])[0],
            half_turn(v0[None], axis=np.zeros(3))[0],
        ),
    ]
    carried = {
        "the first pose held still": (np.zeros(frames), np.zeros((frames, 3))),
        f"the first pose carried {SWAY:g} m aside and back, once a second": (np.zeros(frames), there(SWAY)[:, None] * (1, 0, 0)),
        f"the first pose lifted {SWAY:g} m and set down, once a second": (np.zeros(frames), there(SWAY)[:, None] * (0, 1, 0)),
        "the first pose turned a quarter round and back, once a second": (there(TURN), np.zeros((frames, 3))),
    }
    first = Motion(motion.collider[:1], motion.boundary[:1])
    for said, (turn, shift) in carried.items():
        found.append(NextMotion(said, _each(first, partial(_moved, turn=turn, shift=shift, axis=axis)), x0, np.zeros_like(v0)))
    return found


def _each(motion: Motion, change: Callable[[Array], Array]) -> Motion:
    return Motion(change(motion.collider), change(motion.boundary))


def _there_and_back(frames: int, fps: float, size: float) -> Array:
    """size/2 (1 − cos 2πft) [T]: from rest, to rest."""
    return 0.5 * size * (1 - np.cos(2 * np.pi * HZ * np.arange(frames) / fps))


def _moved(path: Array, turn: Array, shift: Array, axis: Array) -> Array:
    """path [T or 1, N, 3] m turned by `turn` [T or 1] rad about the vertical through `axis` [3] m, then shifted by `shift` [T or 1, 3] m."""
    R = matrix_from_axis_angle(turn[:, None] * (0, 1, 0))
    return np.einsum("tij,tnj->tni", R, np.broadcast_to(path, (max(len(path), len(R)), *path.shape[1:])) - axis) + axis + shift[:, None]


def _at_speed(motion: Motion, speed: float, frames: int) -> Motion:
    """The motion so many times as fast, as far as it goes."""
    T = len(motion.boundary)
    t = speed * np.arange(min(frames, int((T - 1) / speed) + 1))
    return _each(motion, lambda path: CubicSpline(np.arange(T), path)(t) if T > 1 and path.size else path[np.rint(t).astype(int)])
