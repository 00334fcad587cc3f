"""Linear blend skinning and its inverse.

    x_v = (Σ_j w_vj T_j) x̄_v        T_j [4, 4] rest pose to posed, relative to the rest joint (Magnenat-Thalmann et al. 1988)

`unpose` inverts the blended matrix of each vertex. Blending rotations flattens space where they differ much (two of 180° leave a
plane): vertices whose blend squeezes some direction below `SQUEEZE` are un-posed with their heaviest joint alone and flagged.
Pose-dependent blend shapes are not applied, on either way, as in PhysAvatar's released code.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SQUEEZE = 0.2  # [-] smallest singular value; equal blend of two rotations 157° apart


@dataclass(frozen=True)
class Unposed:
    """Rest positions x_rest [V, 3] m, and which vertices were un-posed by one joint because their blend was near-singular [V]."""

    x_rest: Array
    squeezed: NDArray[np.bool_]


def blend(weights: Array, transforms: Array) -> Array:
    """Blended matrices [..., V, 3, 4] of weights [V, joint] and joint transforms [..., joint, 4, 4]."""
    flat = transforms[..., :3, :].reshape(*transforms.shape[:-2], 12)
    return (weights @ flat).reshape(*transforms.shape[:-3], len(weights), 3, 4)


def repose(x_rest: Array, weights: Array, transforms: Array) -> Array:
    """Posed vertices [..., V, 3] m of rest vertices [V, 3] m under transforms [..., joint, 4, 4] (a leading time axis is welcome)."""
    B = blend(weights, transforms)
    return (B[..., :3] @ x_rest[:, :, None])[..., 0] + B[..., 3]


def unpose(vertices: Array, weights: Array, transforms: Array) -> Unposed:
    """Rest vertices of posed ones [V, 3] m, weights [V, joint], transforms [joint, 4, 4] of that one pose."""
    B = blend(weights, transforms)
    squeezed = np.linalg.svd(B[..., :3], compute_uv=False)[:, -1] < SQUEEZE
    B[squeezed] = transforms[weights[squeezed].argmax(1), :3]
    return Unposed(np.linalg.solve(B[..., :3], (vertices - B[..., 3])[:, :, None])[..., 0], squeezed)
