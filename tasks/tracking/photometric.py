"""Photometric term: a point of the surface keeps the colour it had in frame 0, in every camera that sees it.

P(x) = η Σ_s Σ_k a_sk Σ_c ½ log(1 + (r/σ_c)²),  r = I_k,c(π_k(x_s)) − ref_s,k,c,  x_s = Σ_i b_si x_i,  c over R, G, B, mask

with a the facing cosine, or 0 where the sample is hidden (visibility.py), both held constant. Cauchy's loss, minimised by iterated weights:
1/(σ_c²(1 + (r/σ_c)²)). Row of the Jacobian: b_si ∇I · ∂π/∂x, with u = f_x p₀/p₂ + c_x and p = Rx + t.

Samples closer to one another than the blur see the same pixels. η = min(1, A/(4πσ_b²)) counts them once: A is the mean area of a sample
[px²], σ_b the blur and 4πσ_b² the area over which a Gaussian blur leaves one independent value. Without it coarse levels are believed a
hundred times too much.

Source: surface-sample form of the image term of PhysAvatar §3.2 (which splats Gaussians); Cauchy weights after Black & Rangarajan (1996).
Limits: no gradient through occlusion edges (the outline acts through the blurred mask), and shading that changes is not modelled.
"""

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from tasks.geometry.cameras import Cameras
from tasks.tracking.pyramid import Level, look_up

Array = NDArray[np.float64]

_NEAR = 0.01  # [m] closer points give no information


def derivatives(
    x: Array,
    faces: NDArray[np.int32],
    barycentric: Array,
    *,
    level: Level,
    cameras: Cameras,
    weight: NDArray[np.float32],
    reference: NDArray[np.float32],
    sigma: tuple[float, float],
    sample_area: float = np.inf,
) -> tuple[Array, Array, Array]:
    """Energy [F], gradient [F, 3, 3] and Gauss–Newton Hessian [F, 3, 3, 3, 3] by the corners of each face.

    x [V, 3] m; barycentric [n, 3]; weight a [sample, camera]; reference [sample, camera, 4]; sigma of colour and of mask;
    sample_area [px²].
    """
    η = min(1.0, sample_area / (4 * np.pi * level.blur**2))
    F = len(faces)
    energy, g, H = np.zeros(F), np.zeros((F, 3, 3)), np.zeros((F, 3, 3, 3, 3))
    K = cameras.K.copy()
    K[:, :2] /= level.scale
    _fill(
        x,
        faces,
        barycentric,
        level.pixels,
        level.offset,
        level.size,
        K,
        cameras.R,
        cameras.t,
        weight,
        reference,
        sigma[0],
        sigma[1],
        η,
        energy,
        g,
        H,
    )
    return energy, g, H


def residuals(
    x: Array,
    faces: NDArray[np.int32],
    barycentric: Array,
    *,
    level: Level,
    cameras: Cameras,
    weight: NDArray[np.float32],
    reference: NDArray[np.float32],
) -> NDArray[np.float32]:
    """r [sample, camera, 4], NaN where the weight is 0."""
    seen = colours(x, faces, barycentric, level=level, cameras=cameras, weight=weight)
    return seen - reference


def colours(
    x: Array, faces: NDArray[np.int32], barycentric: Array, *, level: Level, cameras: Cameras, weight: NDArray[np.float32]
) -> NDArray[np.float32]:
    """What the cameras see at the samples [sample, camera, 4]; NaN where the weight is 0."""
    K = cameras.K.copy()
    K[:, :2] /= level.scale
    out = np.full((*weight.shape, 4), np.nan, np.float32)
    _look(x, faces, barycentric, level.pixels, level.offset, level.size, K, cameras.R, cameras.t, weight, out)
    return out


@njit(inline="always")
def _place(x, faces, barycentric, f, s, y):
    for a in range(3):
        y[a] = barycentric[s, 0] * x[faces[f, 0], a] + barycentric[s, 1] * x[faces[f, 1], a] + barycentric[s, 2] * x[faces[f, 2], a]


@njit(inline="always")
def _into_camera(R, t, y, p):
    for a in range(3):
        p[a] = R[a, 0] * y[0] + R[a, 1] * y[1] + R[a, 2] * y[2] + t[a]


@njit(parallel=True, cache=True)
def _fill(x, faces, barycentric, pixels, offset, size, K, R, t, weight, reference, sigma_colour, sigma_mask, η, energy, g, H):
    n, cameras = len(barycentric), len(K)
    for f in prange(len(faces)):
        y, p, value, du, dv = np.empty(3), np.empty(3), np.empty(4), np.empty(4), np.empty(4)
        ju, jv, h, d = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty(3)
        for s in range(n):
            _place(x, faces, barycentric, f, s, y)
            h[:], d[:] = 0.0, 0.0
            q = f * n + s
            for k in range(cameras):
                a = η * weight[q, k]
                if a == 0.0:
                    continue
                _into_camera(R[k], t[k], y, p)
                if p[2] < _NEAR:
                    continue
                p0, p1 = p[0] / p[2], p[1] / p[2]
                fu, fv = K[k, 0, 0] / p[2], K[k, 1, 1] / p[2]
                look_up(
                    pixels, offset[k], size[k, 0], size[k, 1], K[k, 0, 0] * p0 + K[k, 0, 2], K[k, 1, 1] * p1 + K[k, 1, 2], value, du, dv
                )
                uu, uv, vv, ru, rv, product = 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
                for c in range(4):
                    r = value[c] - reference[q, k, c]
                    sigma = sigma_colour if c < 3 else sigma_mask
                    cauchy = 1.0 + (r / sigma) ** 2
                    w = a / (cauchy * sigma * sigma)
                    uu += w * du[c] * du[c]
                    uv += w * du[c] * dv[c]
                    vv += w * dv[c] * dv[c]
                    ru += w * r * du[c]
                    rv += w * r * dv[c]
                    product *= cauchy
                energy[f] += 0.5 * a * np.log(product)
                for b in range(3):
                    ju[b] = fu * (R[k, 0, b] - p0 * R[k, 2, b])
                    jv[b] = fv * (R[k, 1, b] - p1 * R[k, 2, b])
                for b in range(3):
                    d[b] += ru * ju[b] + rv * jv[b]
                    for c in range(3):
                        h[b, c] += uu * ju[b] * ju[c] + uv * (ju[b] * jv[c] + jv[b] * ju[c]) + vv * jv[b] * jv[c]
            for i in range(3):
                for b in range(3):
                    g[f, i, b] += barycentric[s, i] * d[b]
                for j in range(3):
                    bb = barycentric[s, i] * barycentric[s, j]
                    for b in range(3):
                        for c in range(3):
                            H[f, i, j, b, c] += bb * h[b, c]


@njit(parallel=True, cache=True)
def _look(x, faces, barycentric, pixels, offset, size, K, R, t, weight, out):
    n = len(barycentric)
    for f in prange(len(faces)):
        y, p, value, du, dv = np.empty(3), np.empty(3), np.empty(4), np.empty(4), np.empty(4)
        for s in range(n):
            _place(x, faces, barycentric, f, s, y)
            q = f * n + s
            for k in range(len(K)):
                if weight[q, k] == 0.0:
                    continue
                _into_camera(R[k], t[k], y, p)
                if p[2] < _NEAR:
                    continue
                u, v = K[k, 0, 0] * p[0] / p[2] + K[k, 0, 2], K[k, 1, 1] * p[1] / p[2] + K[k, 1, 2]
                look_up(pixels, offset[k], size[k, 0], size[k, 1], u, v, value, du, dv)
                for c in range(4):
                    out[q, k, c] = value[c]
