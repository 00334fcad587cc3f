"""How deep cloth that is seen lies inside skin: there one of the two is wrong by at least as much.

Cameras look through up to 2 cm of skin at cloth (visibility.py), so that a fit that begins inside comes out again. Where it ends inside,
a camera k that sees a vertex x_v has a face of skin in front of it, or none:

d_v = min_k max(0, n_k · (x_v − a_k))

a_k is a corner of that face and n_k its unit normal, away from the camera; without a face the camera counts as 0. The least of the cameras
that see the vertex, because an arm before the chest stands in the way of some of them and the chest is not inside it.

Limits: one pixel of a z-buffer per vertex and camera. Where it is the skin that is wrong, its error is counted as the cloth's.
"""

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.cameras import Cameras
from tasks.tracking.surface import Surface
from tasks.tracking.visibility import buffers

Array = NDArray[np.float64]


def depth_in_skin(x: Array, surface: Surface, cameras: Cameras, *, views: NDArray[np.bool_]) -> Array:
    """Depth [V] m of the surface x [V, 3] m, 0 for skin and for what no camera sees; cameras of the z-buffers' size, views [V, camera]."""
    skin = surface.faces[surface.layer == 0]
    cloth = np.setdiff1d(surface.faces, skin)
    if not len(skin):
        return np.zeros(len(x))
    depth = np.full(len(x), np.inf)
    for k, buffer in enumerate(buffers(cameras, x, skin)):
        p, own = x @ cameras.R[k].T + cameras.t[k], cloth[views[cloth, k]]
        depth[own] = np.minimum(depth[own], _behind(p[own], p[skin], cameras.K[k], buffer.face))
    return np.where(np.isfinite(depth), depth, 0.0)


def _behind(p: Array, corners: Array, K: Array, front: NDArray[np.int32]) -> Array:
    """How far [P] m points p [P, 3] lie behind the planes of the faces in front of them, corners [F, 3, 3], all in camera axes;
    front [height, width] the face in each pixel, −1 none.
    """
    u, v = (p[:, :2] / p[:, 2:] * K.diagonal()[:2] + K[:2, 2]).T
    height, width = front.shape
    face = front[np.clip(v.astype(int), 0, height - 1), np.clip(u.astype(int), 0, width - 1)]
    a, b, c = corners[face].swapaxes(0, 1)
    n = np.cross(b - a, c - a)
    n *= (np.sign((n * a).sum(1)) / np.linalg.norm(n, axis=1))[:, None]
    return np.where(face >= 0, np.maximum(((p - a) * n).sum(1), 0.0), 0.0)
