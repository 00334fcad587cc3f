"""Outline term: the rim of the surface lies on the rim of the mask.

P(x) = Σ_k Σ_q ½ log(1 + (d_k(π_k(x_q))/σ)²)

over the pairs q of a pixel of the z-buffer that the surface covers and a neighbour that it does not; d is the signed distance to the
outline of camera k's mask [px], positive inside. The rim runs somewhere between the centres of the two, on average halfway whatever its
direction:

x_q = Σ_i b_i x_i + o_q,   o_q = z/2 (Δu/f_x, Δv/f_y, 0) in camera axes

with b_i the covered pixel's place in its face, z its depth [m], and (Δu, Δv) the step of one pixel to the neighbour. The covered centre
alone lies inside, by more the coarser the buffer, and would push the surface out by as much. Half a pixel further in the face's own plane
would be far off where the face is seen edge-on, as faces on a rim are.

Rims that the mask does not show (an arm before the chest) are not in the sum. Rim points are found anew with every look at what is visible;
their b_i and o_q are held fixed in between, as is the Cauchy loss's σ = max(σ_outline, blur).

The photometric term alone leaves a surface that has shrunk into its own picture where it is: all that it covers has the right colour.
This term does not.

Source: outlines in performance capture, e.g. Vlasic et al. (2008), Articulated mesh animation from multi-view silhouettes, §5. Limits: a
rim point is led to the nearest outline, which may belong to another limb; the loss forgives those that are far.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tasks.geometry.cameras import Cameras
from tasks.geometry.rasterise import Fragments
from tasks.tracking.mask_distance import signed_distance

Array = NDArray[np.float64]

_STEPS = ((-1, 0), (1, 0), (0, -1), (0, 1))  # [px] to the four neighbours, (column, row)


@dataclass(frozen=True)
class Outlines:
    """Signed distance to the masks' outlines [px], positive inside:
    camera k is distance[offset[k] + j·width + i], of size[k] = (width, height).
    """

    distance: NDArray[np.float32]
    offset: NDArray[np.int64]
    size: NDArray[np.int64]


@dataclass(frozen=True)
class Rim:
    """Points on the rim: camera [Q], face [Q], barycentric [Q, 3] of the covered pixel, beyond [Q, 3] m from it, in camera axes."""

    camera: NDArray[np.int64]
    face: NDArray[np.int64]
    barycentric: Array
    beyond: Array


def outlines(stacked: list[NDArray[np.float32]]) -> Outlines:
    """Distances from images [height, width, 4] per camera, whose last channel is the mask."""
    fields = [signed_distance(image[..., 3] > 0.5) for image in stacked]
    size = np.array([(d.shape[1], d.shape[0]) for d in fields], np.int64)
    return Outlines(np.concatenate([d.ravel() for d in fields]), np.concatenate([[0], np.cumsum(size.prod(1))[:-1]]), size)


def rim(buffers: Sequence[Fragments], cameras: Cameras) -> Rim:
    """Halfway between every covered pixel, away from the image's border, and each of its uncovered neighbours;
    cameras of the buffers' size.
    """
    found = [_halfway(k, buffer, cameras.K[k], step) for k, buffer in enumerate(buffers) for step in _STEPS]
    return Rim(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def add_derivatives(
    x: Array,
    faces: NDArray[np.int32],
    rim: Rim,
    *,
    outlines: Outlines,
    cameras: Cameras,
    sigma: float,
    energy: Array,
    gradient: Array,
    hessian: Array,
) -> None:
    """Add to energy [F], gradient [F, 3, 3] and Hessian [F, 3, 3, 3, 3] of the faces, as photometric.derivatives gives them; sigma [px]."""
    _fill(
        x, faces, rim.camera, rim.face, rim.barycentric, rim.beyond, outlines.distance, outlines.offset, outlines.size,
        cameras.K, cameras.R, cameras.t, sigma, energy, gradient, hessian,
    )  # fmt: skip


def _halfway(k: int, buffer: Fragments, K: Array, step: tuple[int, int]) -> tuple[NDArray[np.int64], NDArray[np.int64], Array, Array]:
    """Camera, face, barycentric and beyond of the rim points of camera k whose uncovered pixel lies one `step` (column, row) further."""
    (Δu, Δv), (height, width) = step, buffer.face.shape
    covered = buffer.face >= 0
    further = covered[1 + Δv : height - 1 + Δv, 1 + Δu : width - 1 + Δu]
    j, i = np.array(np.divmod(np.flatnonzero(covered[1:-1, 1:-1] & ~further), width - 2)) + 1
    beyond = buffer.depth[j, i, None] * np.array([Δu / K[0, 0], Δv / K[1, 1], 0.0]) / 2
    return np.full(len(j), k), buffer.face[j, i].astype(np.int64), buffer.barycentric[j, i].astype(float), beyond


@njit(cache=True)
def _fill(x, faces, camera, face, barycentric, beyond, distance, offset, size, K, R, t, sigma, energy, g, H):
    J, p = np.empty(3), np.empty(3)
    for q in range(len(face)):
        k, f = camera[q], face[q]
        for a in range(3):
            p[a] = t[k, a] + beyond[q, a]
        for i in range(3):
            for a in range(3):
                for c in range(3):
                    p[a] += barycentric[q, i] * R[k, a, c] * x[faces[f, i], c]
        if p[2] < 0.01:
            continue
        width, height = size[k]
        u, v = K[k, 0, 0] * p[0] / p[2] + K[k, 0, 2] - 0.5, K[k, 1, 1] * p[1] / p[2] + K[k, 1, 2] - 0.5
        if not (u >= 0 and v >= 0 and u < width - 1 and v < height - 1):
            continue
        i, j = int(u), int(v)
        n, s, r = offset[k] + j * width + i, u - i, v - j
        d00, d10, d01, d11 = distance[n], distance[n + 1], distance[n + width], distance[n + width + 1]
        d = (1 - r) * ((1 - s) * d00 + s * d10) + r * ((1 - s) * d01 + s * d11)
        du, dv = (1 - r) * (d10 - d00) + r * (d11 - d01), (1 - s) * (d01 - d00) + s * (d11 - d10)
        cauchy = 1.0 + (d / sigma) ** 2
        w = 1.0 / (sigma * sigma * cauchy)
        energy[f] += 0.5 * np.log(cauchy)
        for c in range(3):
            J[c] = du * K[k, 0, 0] / p[2] * (R[k, 0, c] - p[0] / p[2] * R[k, 2, c]) + dv * K[k, 1, 1] / p[2] * (
                R[k, 1, c] - p[1] / p[2] * R[k, 2, c]
            )
        for a in range(3):
            for c in range(3):
                g[f, a, c] += w * d * barycentric[q, a] * J[c]
                for b in range(3):
                    for e in range(3):
                        H[f, a, b, c, e] += w * barycentric[q, a] * barycentric[q, b] * J[c] * J[e]
