"""Bending of the generator: hinges in φ = 2 tan(θ/2), with viscosity, hysteresis and creases.

    m = k (φ − φ̄) + β k φ̇ + z,      f = −m φ'(θ) ∂θ/∂x        (Newton's matrix keeps m' φ'² ∂θ ∂θᵀ, which is never indefinite)

k = w B |ē|/h̄ with one w per mesh, chosen so that the mesh rolled into a cylinder, averaged over directions, has the energy ½ B κ² A.
z: a friction moment (`spring_slider.py`).
Source: discrete shells, Grinspun et al. 2003, with the half-angle tangent of Bridson et al. 2003 and Burgoon et al. 2006.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tasks.exam.generator.spring_slider import spring_slider
from tasks.geometry.meshes import hinges
from tasks.geometry.simplex_distances import cross, dot, length, minus, row

Array = NDArray[np.float64]
Indices = NDArray[np.int32]


def hinge_weights(rest: Array, faces: Indices, stencil: Indices) -> Array:
    """w |ē|/h̄ [H]: what the rigidity B multiplies; h̄: a third of the two triangles' heights together."""
    a, b, c, d = (rest[stencil[:, k]] for k in range(4))
    length = np.linalg.norm(b - a, axis=1)
    areas = [np.linalg.norm(np.cross(b - a, p - a), axis=1) / 2 for p in (c, d)]
    shape = 3 * length**2 / (2 * (areas[0] + areas[1]))
    flat = np.zeros((len(stencil), 4, 2))  # the hinge laid flat, its edge along the first axis
    flat[:, 1, 0] = length
    for k, p, side in ((2, c, 1), (3, d, -1)):
        flat[:, k, 0] = np.sum((p - a) * (b - a), 1) / length
        flat[:, k, 1] = side * 2 * areas[k - 2] / length
    energy = np.mean([shape @ _rolled(flat, angle) ** 2 for angle in np.arange(6) * np.pi / 6])
    sheet = np.linalg.norm(np.cross(rest[faces[:, 1]] - rest[faces[:, 0]], rest[faces[:, 2]] - rest[faces[:, 0]]), axis=1).sum() / 2
    return shape * sheet / energy


def _rolled(flat: Array, angle: float) -> Array:
    """Fold [H] per unit curvature of hinges [H, 4, 2] rolled into a wide cylinder whose axis stands at `angle` to their edges."""
    R = 100 * np.ptp(flat, axis=1).max()
    along, across = flat @ [np.cos(angle), np.sin(angle)], flat @ [-np.sin(angle), np.cos(angle)]
    x = np.stack([along, R * np.sin(across / R), R * np.cos(across / R)], -1).reshape(-1, 3)
    return R * hinge_angles(x, np.arange(len(x), dtype=np.int32).reshape(-1, 4))


def hinge_stencils(faces: Indices) -> Indices:
    """Hinges [H, 4] (edge, then the two opposite corners)."""
    return np.ascontiguousarray(hinges(faces))


@njit(cache=True, nogil=True)
def hinge_angles(x, stencil):
    """φ = 2 tan(θ/2) [H]."""
    out = np.empty(len(stencil))
    grad = np.empty((4, 3))
    for h in range(len(stencil)):
        out[h] = 2 * np.tan(_angle(x, stencil[h], grad) / 2)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def bend(x, stencil, k, rest, viscosity, φ_hat, s, limit, reach, z0, force, slots, data):
    """Add forces and, through `slots` [H, 12, 12], the matrix; returns φ [H] and the friction moment z [H].

    z0 [H, 2]: last φ and z;
    limit, reach [H]: greatest friction moment and the angle that builds it up."""
    φs, z1 = np.empty(len(stencil)), np.empty(len(stencil))
    grad = np.empty((4, 3))
    flat = grad.ravel()  # the same memory
    for h in range(len(stencil)):
        θ = _angle(x, stencil[h], grad)
        t = np.tan(θ / 2)
        φ, slope = 2 * t, 1 + t * t
        φs[h] = φ
        m = k[h] * (φ - rest[h]) + viscosity * k[h] * (φ - φ_hat[h]) / s
        dm = k[h] * (1 + viscosity / s)
        z1[h] = 0.0
        if limit[h] > 0:
            z, dz = spring_slider(z0[h, 1], φ - z0[h, 0], limit[h], reach[h])
            z1[h] = z
            m += z
            dm += dz
        for p in range(12):
            force[stencil[h, p // 3], p % 3] -= m * slope * flat[p]
            moved = dm * slope * slope * flat[p]
            for q in range(12):
                slot = slots[h, p, q]
                if slot >= 0:
                    data[slot] += moved * flat[q]
    return φs, z1


@njit(cache=True, nogil=True, error_model="numpy")
def _angle(x, hinge, grad):
    """θ of the hinge; fills ∂θ [4, 3]."""
    a = row(x, hinge[0])
    e, to_c, to_d = minus(row(x, hinge[1]), a), minus(row(x, hinge[2]), a), minus(row(x, hinge[3]), a)
    n1, n2, edge = cross(e, to_c), cross(to_d, e), length(e)
    θ = np.arctan2(dot(cross(n1, n2), e) / edge, dot(n1, n2))
    s1, s2 = -edge / dot(n1, n1), -edge / dot(n2, n2)
    αc, αd = dot(to_c, e) / edge**2, dot(to_d, e) / edge**2
    for i in range(3):
        gc, gd = s1 * n1[i], s2 * n2[i]
        grad[2, i], grad[3, i] = gc, gd
        grad[0, i], grad[1, i] = -(1 - αc) * gc - (1 - αd) * gd, -αc * gc - αd * gd
    return θ
