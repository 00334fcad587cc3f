"""A limb of two bones that reaches a given point: world rotations of its bones, in closed form (law of cosines).

With bone lengths l₁, l₂ and the distance d from root to target, the angle at the root is  cos α = (l₁² + d² − l₂²) / (2 l₁ d).
The middle joint lies on the side of `facing`. A target out of reach is approached as far as a nearly straight limb goes.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

REACH = 0.999  # of l₁ + l₂; a straight knee has no well-defined side


def two_bone_limb(root: Array, target: Array, rest: Array, facing: Array, *, rest_facing: Array) -> tuple[Array, Array]:
    """World rotations [time, 3, 3] of the upper and lower bone.

    root, target [time, 3] m; rest [3, 3] m = root, middle and end joint at rest; facing [time, 3] the direction in which the middle
    joint points now, rest_facing [3] at rest.
    """
    l1, l2 = np.linalg.norm(np.diff(rest, axis=0), axis=1)
    along = target - root
    d = np.clip(np.linalg.norm(along, axis=1), abs(l1 - l2) + 1e-6, REACH * (l1 + l2))
    cosα = (l1**2 + d**2 - l2**2) / (2 * l1 * d)
    frame = _frame(along, facing)
    upper = cosα[:, None] * frame[..., 0] + np.sqrt(1 - cosα**2)[:, None] * frame[..., 1]
    end = d[:, None] * frame[..., 0]
    lower = (end - l1 * upper) / l2
    rotations = [
        _frame(now, facing) @ _frame((rest[k + 1] - rest[k])[None], rest_facing[None])[0].T for k, now in enumerate((upper, lower))
    ]
    return rotations[0], rotations[1]


def _frame(along: Array, facing: Array) -> Array:
    """Orthonormal columns: along, facing made perpendicular to it, their cross product; [time, 3], [time, 3] -> [time, 3, 3]."""
    a = along / np.linalg.norm(along, axis=-1, keepdims=True)
    f = facing - np.sum(facing * a, -1, keepdims=True) * a
    f = f / np.linalg.norm(f, axis=-1, keepdims=True)
    return np.stack([a, f, np.cross(a, f)], -1)
