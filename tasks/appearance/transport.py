"""Where light comes from at every surface point: the table of what rays from each node meet.

A *node* is a vertex and a side, displaced `LIFT` along ± its normal; node = side·V + vertex. From each, R rays are cast with cosine
density, so that with constant light from everywhere

    visibility        V_i  = share of rays that escape
    form factor       K_if = share of rays that meet face-side f          (K rows and V sum to 1)

are counts, and irradiance needs no form-factor matrix (`radiosity.py`). Directions are a Fibonacci set on the disk (Malley's lift),
shifted at random per node: error R^−0.9 where independent rays have R^−0.5.
Limits: irradiance varies linearly over a face, so shadows finer than an edge are blurred; no transmission through cloth.
"""

import numpy as np
from numpy.typing import NDArray

from tasks.appearance.ray_tracer import RayTracer
from tasks.geometry.meshes import vertex_normals

Array = NDArray[np.float64]
Hits = NDArray[np.int32]  # [node, ray]: 2·face + side, −1 for the sky

LIFT = 2e-4  # [m] off the surface: above single precision at 3 m, below any cloth's distance from skin
RAYS = 256  # rendering experiments: 64 limit the texture by noise


def trace_transport(tracer: RayTracer, vertices: Array, faces: NDArray[np.int32], *, rays: int = RAYS, seed: int = 0) -> Hits:
    """What the rays of both sides of every vertex [V, 3] m meet: [2V, ray]."""
    tracer.move(vertices)
    normal = vertex_normals(vertices, faces)
    normal = np.concatenate([normal, -normal])
    origin = np.concatenate([vertices, vertices]) + LIFT * normal
    direction = cosine_directions(normal, rays=rays, seed=seed)
    return tracer.first_hits(np.repeat(origin, rays, axis=0), direction.reshape(-1, 3)).reshape(len(normal), rays)


def visibility(hits: Hits) -> Array:
    """Share of the sky, cosine-weighted, that each node sees [node]."""
    return (hits < 0).mean(1)


def form_factors(hits: Hits, face_count: int):
    """K [node, 2·face + side], sparse: the share of each node's cosine-weighted hemisphere that a face-side fills."""
    from scipy.sparse import coo_matrix

    node, ray = np.nonzero(hits >= 0)
    return coo_matrix((np.full(len(node), 1 / hits.shape[1]), (node, hits[node, ray])), shape=(len(hits), 2 * face_count)).tocsr()


def cosine_directions(normal: Array, *, rays: int, seed: int) -> Array:
    """Unit directions [node, ray, 3] about unit normals [node, 3], density cos θ/π."""
    i = np.arange(rays)
    shift = np.random.default_rng(seed).random((len(normal), 2, 1))
    u = ((i + 0.5) / rays + shift[:, 0]) % 1.0
    φ = 2 * np.pi * ((i * (np.sqrt(5) - 1) / 2 + shift[:, 1]) % 1.0)
    r = np.sqrt(u)
    x, y = _tangents(normal)
    local = np.stack([r * np.cos(φ), r * np.sin(φ), np.sqrt(1 - u)], -1)
    return np.einsum("nra,nac->nrc", local, np.stack([x, y, normal], 1))


def _tangents(n: Array) -> tuple[Array, Array]:
    """Two tangents of unit normals, continuous but at one pole (Duff et al. 2017)."""
    s = np.where(n[:, 2] >= 0, 1.0, -1.0)
    a = -1 / (s + n[:, 2])
    b = n[:, 0] * n[:, 1] * a
    x = np.stack([1 + s * n[:, 0] ** 2 * a, s * b, -s * n[:, 0]], 1)
    return x, np.stack([b, s + n[:, 1] ** 2 * a, -n[:, 1]], 1)
