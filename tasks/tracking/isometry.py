"""ISO: edges keep the length they had in the template.

P(x) = ½ Σ_e w_e ((l_e − l⁰_e)/l⁰_e)²,  w_e = A_e/(A_ref σ²)

with l⁰ from frame 0 (or from the predicted body, whose skin does stretch), σ the strain that counts as one standard deviation and
A_e/A_ref the share of surface that belongs to the edge, relative to that on an equilateral mesh with edges of 24 mm, so that a finer mesh
is not a stiffer one.

Source: the isometry loss of Dynamic 3D Gaussians (Luiten et al. 2024), over vertex neighbours and as a squared relative difference
(a signed difference averages to nothing). Limits: resists shear only through the triangles' diagonals; the Hessian is the Gauss–Newton
part, w/l⁰² d dᵀ with d the unit edge, which is what keeps it positive.
"""

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from tasks.geometry.meshes import face_areas

Array = NDArray[np.float64]

REFERENCE_EDGE = 0.024  # [m] the mesh on which σ was chosen
_EQUILATERAL = np.sqrt(3) / 6  # area per edge over squared edge length


def weights(vertices: Array, faces: NDArray[np.integer], edges: NDArray[np.integer], *, sigma: float) -> Array:
    """w_e [E] for a strain of `sigma`: a third of the area of the faces beside the edge, over A_ref, over σ²."""
    third = np.repeat(face_areas(vertices, faces) / 3, 3)
    n = len(vertices)
    sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64), axis=1)
    keys = edges[:, 0].astype(np.int64) * n + edges[:, 1]
    area = np.bincount(np.searchsorted(keys, sides[:, 0] * n + sides[:, 1]), third, minlength=len(edges))
    return area / (_EQUILATERAL * REFERENCE_EDGE**2) / sigma**2


def derivatives(x: Array, edges: NDArray[np.integer], rest: Array, weight: Array) -> tuple[Array, Array, Array]:
    """Energy [E], gradient [E, 2, 3] and Gauss–Newton Hessian [E, 2, 2, 3, 3] at vertices x [V, 3] m; rest lengths [E] m, weight [E]."""
    E = len(edges)
    energy, g, H = np.empty(E), np.empty((E, 2, 3)), np.empty((E, 2, 2, 3, 3))
    _fill(x, edges, rest, weight, energy, g, H)
    return energy, g, H


@njit(parallel=True, cache=True)
def _fill(x, edges, rest, weight, energy, g, H):
    for e in prange(len(edges)):
        i, j = edges[e]
        d = x[j] - x[i]
        l = np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        r = (l - rest[e]) / rest[e]
        energy[e] = 0.5 * weight[e] * r * r
        d = d / max(l, 1e-12)
        for a in range(3):
            g[e, 1, a] = weight[e] * r / rest[e] * d[a]
            g[e, 0, a] = -g[e, 1, a]
            for b in range(3):
                h = weight[e] / rest[e] ** 2 * d[a] * d[b]
                H[e, 0, 0, a, b], H[e, 1, 1, a, b] = h, h
                H[e, 0, 1, a, b], H[e, 1, 0, a, b] = -h, -h
