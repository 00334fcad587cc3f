"""Irradiance under constant light with diffuse interreflection.

    A_i = V_i + Σ_f K_if B_f,     B_f = ρ_f · mean of A over the three nodes of face-side f

per colour channel. A is irradiance over π L_a: 1 where a point sees only sky, so a pixel shows ρ·A·L_a. Solved by fixed point,
which contracts by max(ρ) < 1 (Cohen & Wallace 1993, §5.3: gathering).
"""

import numba
import numpy as np
from numpy.typing import NDArray

from tasks.appearance.transport import Hits

TOLERANCE, SWEEPS = 1e-4, 100  # [-] change of A at which to stop; most sweeps


def irradiance(hits: Hits, faces: NDArray[np.int32], face_albedo: NDArray) -> NDArray[np.float32]:
    """A [node, 3] from rays `hits` [node, ray] and the mean albedo of each face [F, 3], linear."""
    vertex_count = len(hits) // 2
    corner_nodes = np.concatenate([faces, faces + vertex_count], 1).reshape(-1, 3)  # row 2·face + side
    ρ = np.repeat(np.asarray(face_albedo, np.float32), 2, axis=0)
    A = np.ones((len(hits), 3), np.float32) * (hits < 0).mean(1, dtype=np.float32)[:, None]
    for _ in range(SWEEPS):
        before, A = A, _gather(hits, np.ascontiguousarray(ρ * A[corner_nodes].mean(1)))
        if np.abs(A - before).max() < TOLERANCE:
            break
    return A


@numba.njit(cache=True, nogil=True)
def _gather(hits, B):
    nodes, rays = hits.shape
    A = np.zeros((nodes, 3), np.float32)
    for i in range(nodes):
        sky, r, g, b = 0, np.float32(0), np.float32(0), np.float32(0)
        for k in range(rays):
            f = hits[i, k]
            if f < 0:
                sky += 1
            else:
                r += B[f, 0]
                g += B[f, 1]
                b += B[f, 2]
        A[i, 0], A[i, 1], A[i, 2] = (sky + r) / rays, (sky + g) / rays, (sky + b) / rays
    return A
