"""A skeleton's motion as a scene graph wants it: every joint relative to its parent, as translation, rotation and scale.

A skin transform Tⱼ takes the rest pose to the frame, so joint j stands at Gⱼ = Tⱼ · translate(rest joint j), and relative to its
parent p at Lⱼ = Gₚ⁻¹ Gⱼ. The inverse bind matrix is translate(−rest joint j): then Σ wⱼ Gⱼ Bⱼ x = Σ wⱼ Tⱼ x, linear blend skinning.

Limits: Lⱼ must be a similarity (rotation, one scale, translation): a scene graph has no shear.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tasks.geometry.faults import BadInput, Fault

SHEAR_TO = 1e-4  # of the axes' length; float32 transforms compose to about 1e-6


@dataclass(frozen=True)
class Skeleton:
    """names [J], parents [J] (−1 for the root, which comes first; a parent comes before its children), joints [J, 3] m at rest."""

    names: tuple[str, ...]
    parents: NDArray
    joints: NDArray


@dataclass(frozen=True)
class LocalMotion:
    """Relative to the parent: translation [T, J, 3] m, rotation [T, J, 4] quaternions x y z w, scale [T, J]."""

    translation: NDArray
    rotation: NDArray
    scale: NDArray


def rest_translations(skeleton: Skeleton) -> NDArray:
    """Each joint from its parent at rest, [J, 3] m."""
    return skeleton.joints - np.where(skeleton.parents[:, None] < 0, 0, skeleton.joints[skeleton.parents])


def inverse_bind_matrices(skeleton: Skeleton) -> NDArray:
    """World at rest -> joint, [J, 4, 4]."""
    B = np.tile(np.eye(4), (len(skeleton.joints), 1, 1))
    B[:, :3, 3] = -skeleton.joints
    return B


def local_motion(skeleton: Skeleton, transforms: NDArray) -> LocalMotion:
    """Skin transforms [T, J, 4, 4] as motion relative to the parents. Raises BadInput where a transform shears."""
    G = transforms.astype(float) @ np.linalg.inv(inverse_bind_matrices(skeleton))
    L = G.copy()
    children = np.flatnonzero(skeleton.parents >= 0)
    L[:, children] = np.linalg.inv(G[:, skeleton.parents[children]]) @ G[:, children]
    A = L[..., :3, :3]
    scale = np.cbrt(np.linalg.det(A))
    R = A / np.where(scale == 0, 1, scale)[..., None, None]
    shear = np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max(axis=(-1, -2))
    if not (shear < SHEAR_TO).all():
        frame, joint = np.unravel_index(np.nanargmax(np.where(np.isnan(shear), np.inf, shear)), shape=shear.shape)
        what = f"frame {frame}, joint {skeleton.names[joint]} is no similarity (its axes are off by {shear[frame, joint]:.2g})"
        raise BadInput([Fault("transforms", what, "export the point cache instead, or fit without shear")])
    rotation = _continuous(Rotation.from_matrix(R.reshape(-1, 3, 3)).as_quat().reshape(*scale.shape, 4))
    return LocalMotion(L[..., :3, 3], rotation, scale)


def _continuous(q: NDArray) -> NDArray:
    """q and −q are one rotation; of the two the one nearer to the frame before, so that in-between frames do not spin."""
    turned = np.ones(q.shape[:2])
    turned[1:] = np.cumprod(np.where((q[1:] * q[:-1]).sum(axis=-1) < 0, -1.0, 1.0), axis=0)
    return q * turned[..., None]
