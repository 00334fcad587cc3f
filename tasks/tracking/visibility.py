"""Which camera sees which sample, from z-buffers of the present surface and of an optional occluder.

A sample is compared at the centre of the buffer's pixel it falls into, with the depth that the plane of its own face has there, so that
slanted faces need no slack. It counts as seen if it lies no further behind the buffer than a tolerance:

- τ (a share of the mean edge) behind cloth or skin of its own layer;
- the layer tolerance, for cloth behind skin: cloth is worn outside, so there it is the tracking that is wrong (by how
  much is stated as noise: inside_skin.py);
- nothing, for skin behind cloth;
- the occluder tolerance behind the occluder, an approximate body that the template does not contain.

Limits: one sample, one pixel; no partial visibility.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numba
import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from tasks.geometry.cameras import Cameras
from tasks.geometry.rasterise import Fragments, rasterise
from tasks.tracking.settings import Settings
from tasks.tracking.surface import Surface

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Occluder:
    """A mesh that hides samples but is not tracked: vertices [C, 3] m at one instant, faces [G, 3]."""

    vertices: Array
    faces: NDArray[np.int32]


def facing_cosines(
    x: Array,
    surface: Surface,
    cameras: Cameras,
    *,
    occluder: Occluder | None,
    side: NDArray[np.int8] | None,
    facing: float,
    settings: Settings,
    own: Sequence[Fragments] | None = None,
) -> NDArray[np.float32]:
    """Cosine between face normal and line of sight [sample, camera]: positive on the face's outer side, negative on its inner, 0 where
    unseen.

    x [V, 3] m. `side` [sample] (+1 outer, −1 inner) keeps only views of that side; None keeps both.
    `own` are the surface's z-buffers at Settings.buffer_scale, where they are at hand.
    """
    seen = np.zeros((surface.samples, len(cameras)), np.float32)
    small = cameras.scaled(settings.buffer_scale)
    tolerance = _tolerances(surface, settings)
    nowhere = np.zeros(surface.samples, np.int8) if side is None else side
    empty = np.full((1, 1), np.inf, np.float32)
    own = buffers(small, x, surface.faces) if own is None else own
    other = [None] * len(cameras) if occluder is None else buffers(small, occluder.vertices, occluder.faces)
    for k, (buffer, veil) in enumerate(zip(own, other, strict=True)):
        depth = empty if veil is None else veil.depth
        _see(
            x, surface.faces, surface.barycentric, surface.layer, small.K[k], cameras.R[k], cameras.t[k],
            buffer.face, buffer.depth, depth, tolerance, settings.occluder_tolerance, facing, nowhere, seen[:, k],
        )  # fmt: skip
    return seen


def buffers(cameras: Cameras, vertices: Array, faces: NDArray[np.int32]) -> Sequence[Fragments]:
    """Z-buffers of a mesh [V, 3] m, [F, 3], one per camera."""

    def one(k: int) -> Fragments:
        return rasterise(cameras.K[k], cameras.R[k], cameras.t[k], cameras.size[k], vertices, faces)

    with ThreadPoolExecutor(numba.get_num_threads()) as pool:
        return list(pool.map(one, range(len(cameras))))


def _tolerances(surface: Surface, settings: Settings) -> Array:
    """Slack [layer of the sample, layer in front of it] m."""
    τ = settings.depth_tolerance_edges * surface.mean_edge
    return np.array([[τ, 1e-3], [max(τ, settings.layer_tolerance), τ]])


@njit(parallel=True, cache=True)
def _see(x, faces, barycentric, layer, K, R, t, front, depth, veil, tolerance, veil_tolerance, facing, side, seen):
    n = len(barycentric)
    height, width = depth.shape
    for f in prange(len(faces)):
        p = np.empty((3, 3))
        for i in range(3):
            v = faces[f, i]
            for a in range(3):
                p[i, a] = R[a, 0] * x[v, 0] + R[a, 1] * x[v, 1] + R[a, 2] * x[v, 2] + t[a]
        e0, e1, e2 = p[1, 0] - p[0, 0], p[1, 1] - p[0, 1], p[1, 2] - p[0, 2]
        g0, g1, g2 = p[2, 0] - p[0, 0], p[2, 1] - p[0, 1], p[2, 2] - p[0, 2]
        n0, n1, n2 = e1 * g2 - e2 * g1, e2 * g0 - e0 * g2, e0 * g1 - e1 * g0
        size = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
        if size == 0.0:
            continue
        n0, n1, n2 = n0 / size, n1 / size, n2 / size
        plane = n0 * p[0, 0] + n1 * p[0, 1] + n2 * p[0, 2]
        for s in range(n):
            b0, b1, b2 = barycentric[s, 0], barycentric[s, 1], barycentric[s, 2]
            q0, q1 = b0 * p[0, 0] + b1 * p[1, 0] + b2 * p[2, 0], b0 * p[0, 1] + b1 * p[1, 1] + b2 * p[2, 1]
            q2 = b0 * p[0, 2] + b1 * p[1, 2] + b2 * p[2, 2]
            if q2 < 0.01:
                continue
            cosine = -plane / np.sqrt(q0 * q0 + q1 * q1 + q2 * q2)
            if abs(cosine) < facing or cosine * side[f * n + s] < 0.0:
                continue
            u, v = K[0, 0] * q0 / q2 + K[0, 2], K[1, 1] * q1 / q2 + K[1, 2]
            if u < 0.5 or v < 0.5 or u > width - 0.5 or v > height - 0.5:
                continue
            i, j = int(u), int(v)
            along = n0 * (i + 0.5 - K[0, 2]) / K[0, 0] + n1 * (j + 0.5 - K[1, 2]) / K[1, 1] + n2
            z = plane / along if abs(along) > 0.05 else q2
            z = min(max(z, q2 - 0.02), q2 + 0.02)  # a grazing plane must not run away within one pixel
            hidden = front[j, i] >= 0 and front[j, i] != f and z > depth[j, i] + tolerance[layer[f], layer[front[j, i]]]
            if not hidden and veil.shape[0] > 1:
                hidden = z > veil[j, i] + veil_tolerance
            if not hidden:
                seen[f * n + s] = cosine
