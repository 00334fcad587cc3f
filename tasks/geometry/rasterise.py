"""Z-buffer rasterisation of triangle meshes in compiled code: which face, where in it, how far.

Perspective-correct barycentric coordinates by interpolation of 1/z (Blinn 1992); triangles that cross the near plane are clipped
conservatively: pixels are tested by their own depth, so nothing wraps around behind the camera.
"""

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from tasks.geometry.simplex_distances import cross

NEAR = 1e-3  # [m]


@dataclass(frozen=True)
class Fragments:
    """What each pixel sees: face [height, width] (−1 none), barycentric [height, width, 3], depth [height, width] m (inf none)."""

    face: NDArray[np.int32]
    barycentric: NDArray[np.float32]
    depth: NDArray[np.float32]


def rasterise(K: NDArray, R: NDArray, t: NDArray, size: tuple[int, int], vertices: NDArray, faces: NDArray) -> Fragments:
    """Fragments of a mesh (vertices [V, 3] m, faces [F, 3]) in a distortion-free camera; size is (width, height) px. Both sides are seen."""
    width, height = int(size[0]), int(size[1])
    face = np.full((height, width), -1, np.int32)
    barycentric = np.zeros((height, width, 3), np.float32)
    depth = np.full((height, width), np.inf, np.float32)
    p = np.ascontiguousarray(vertices @ R.T + t, dtype=np.float64)
    _fill(p, np.ascontiguousarray(faces, dtype=np.int32), K[0, 0], K[1, 1], K[0, 2], K[1, 2], face, barycentric, depth)
    return Fragments(face, barycentric, depth)


@numba.njit(cache=True, nogil=True)
def _fill(p, faces, fx, fy, cx, cy, face, barycentric, depth):
    height, width = depth.shape
    for f in range(len(faces)):
        i0, i1, i2 = faces[f]
        a, b, c = p[i0], p[i1], p[i2]
        if a[2] < NEAR and b[2] < NEAR and c[2] < NEAR:
            continue
        x0, x1, y0, y1 = _bounds(a, b, c, fx, fy, cx, cy, width, height)
        # ray r = (u, v, 1) meets the plane where det[b×c, c×a, a×b]·r decides: homogeneous edge functions (Olano & Greer 1997)
        na, nb, nc = cross(b, c), cross(c, a), cross(a, b)
        det = a[0] * na[0] + a[1] * na[1] + a[2] * na[2]
        if det == 0.0:
            continue
        for j in range(y0, y1):
            v = (j + 0.5 - cy) / fy
            for i in range(x0, x1):
                u = (i + 0.5 - cx) / fx
                wa = (na[0] * u + na[1] * v + na[2]) / det
                wb = (nb[0] * u + nb[1] * v + nb[2]) / det
                wc = (nc[0] * u + nc[1] * v + nc[2]) / det
                s = wa + wb + wc  # = 1/z on the plane
                if wa < 0.0 or wb < 0.0 or wc < 0.0 or s <= 0.0:
                    continue
                z = 1.0 / s
                if z < NEAR or z >= depth[j, i]:
                    continue
                depth[j, i] = z
                face[j, i] = f
                barycentric[j, i, 0], barycentric[j, i, 1], barycentric[j, i, 2] = wa * z, wb * z, wc * z


@numba.njit(cache=True, nogil=True)
def _bounds(a, b, c, fx, fy, cx, cy, width, height):
    if a[2] < NEAR or b[2] < NEAR or c[2] < NEAR:
        return 0, width, 0, height
    ua, ub, uc = a[0] / a[2] * fx + cx, b[0] / b[2] * fx + cx, c[0] / c[2] * fx + cx
    va, vb, vc = a[1] / a[2] * fy + cy, b[1] / b[2] * fy + cy, c[1] / c[2] * fy + cy
    x0, x1 = np.floor(min(ua, ub, uc) - 0.5), np.ceil(max(ua, ub, uc) + 0.5)
    y0, y1 = np.floor(min(va, vb, vc) - 0.5), np.ceil(max(va, vb, vc) + 0.5)
    return int(max(x0, 0)), int(min(max(x1, 0), width)), int(max(y0, 0)), int(min(max(y1, 0), height))
