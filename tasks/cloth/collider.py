"""A collider drawn in where the garment was seen deeper inside than noise explains.

A fitted body is off by millimetres to a centimetre and ignores flattened flesh; tracked cloth is off, too, now here, now there. Simulated
cloth is kept outside wherever it was seen (`start_state.py` walks it from frame to frame), so nothing has to give way to noise. Where a
sample of the garment with barycentric coordinates b on the nearest face lies deeper by ℓ, its corners are drawn in along their normals by
the least that frees it,

    d = ℓ b/‖b‖²        of all d with b·d = ℓ the smallest,

until none does. So much for one frame; in those before and after it the depth is halved with every frame. Where the garment was not seen,
nothing gives way. What of its own body the pipeline leaves out, nobody else's loses (`worn_collider.py`).

Source: Kaczmarz 1937 (the step). Limits: a body that is too thin is left so; what would have to give way by more than `DEEPEST` gives way
by that.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.distances import Closest, closest_points
from tasks.geometry.meshes import edges, vertex_normals

Array = NDArray[np.float64]
Faces = NDArray[np.int32]

POKE_M = 1e-3  # [m] of a garment without noise inside the body
DEVIATIONS = 3.0  # of the noise that it explains
FASTENED_CLEARANCE = 6e-3  # [m] at driven nodes: neither they nor the body can give way, so nothing may come between them
DEEPEST = 0.03  # [m] further no body gives way
LIMB = 0.05  # [m] deeper inside is another limb's cloth, not a fit error
ROUNDS = 30
FURTHER = 1.05  # than is missing, so that rounds end


@dataclass(frozen=True)
class FittedCollider:
    """motion [T, C, 3] m, faces [G, 3], and how far each vertex was drawn in [T, C] m."""

    motion: Array
    faces: Faces
    drawn_in: Array


def explained(noise: float) -> float:
    """How deep [m] in the body a garment may have been seen by the noise [m] of its coordinates."""
    return max(POKE_M, DEVIATIONS * noise)


def fitted_collider(
    body: Array, body_faces: Faces, garment: Array, garment_faces: Faces, *, fastened: Faces, noise: float
) -> FittedCollider:
    """A body [T, C, 3] m as collider of a garment [T, V, 3] m (NaN where not known), noise [m] per coordinate, driven at the nodes
    `fastened` [B]: all of its faces, drawn in.
    """
    normals = np.stack([vertex_normals(x, body_faces) for x in body])
    driven = np.isin(np.arange(garment.shape[1]), fastened).astype(float)[:, None]
    clearance = np.where(_samples(driven, garment_faces)[:, 0] > 0, FASTENED_CLEARANCE, -explained(noise))
    each = zip(garment, body, normals, strict=True)
    depth = _fading(np.stack([_cleared(_samples(x, garment_faces), clearance, b, n, body_faces) for x, b, n in each]))
    return FittedCollider(body - depth[..., None] * normals, body_faces, depth)


def deepest_poke(body: Array, body_faces: Faces, garment: Array) -> float:
    """How far [m] the garment [T, V, 3] m (NaN where not known) reaches into the body [T, C, 3] m at most; what is `LIMB` deep lies on
    another limb.
    """
    deepest = 0.0
    for x, b in zip(garment, body, strict=True):
        known = np.isfinite(x).all(1)
        if not known.any():
            continue
        near, side = _sides(x[known], b, body_faces)
        inside = (side < 0) & (near.distance < LIMB)
        deepest = max(deepest, float(near.distance[inside].max(initial=0.0)))
    return deepest


def _cleared(samples: Array, clearance: Array, body: Array, normals: Array, faces: Faces) -> Array:
    """The depths [C] m at which the samples [n, 3] m of one frame, as far as they are known, are clear."""
    depth, known = np.zeros(len(body)), np.isfinite(samples).all(1)
    if not known.any():
        return depth
    samples, clearance = samples[known], clearance[known]
    for _ in range(ROUNDS):
        missing = _missing(samples, clearance, body - depth[:, None] * normals, faces)
        if missing.max() <= 0:
            break
        depth = np.minimum(depth + missing, DEEPEST)
    return depth


def _fading(depth: Array) -> Array:
    """Depths [T, C] m that come and go by halves, nowhere less than these."""
    out = depth.copy()
    for t in range(1, len(out)):
        out[t] = np.maximum(out[t], out[t - 1] / 2)
    for t in reversed(range(len(out) - 1)):
        out[t] = np.maximum(out[t], out[t + 1] / 2)
    return out


def _samples(x: Array, faces: Faces) -> Array:
    e = edges(faces)
    return np.concatenate([x, x[faces].mean(1), x[e].mean(1)])


def _missing(samples: Array, clearance: Array, collider: Array, faces: Faces) -> Array:
    """How much deeper each collider vertex must lie [C] m for the samples to be clear of it."""
    near, side = _sides(samples, collider, faces)
    lack = clearance - side * near.distance
    close = (lack > 0) & (near.distance < LIMB)
    b = near.barycentric[close]
    missing = np.zeros(len(collider))
    np.maximum.at(missing, faces[near.face[close]], FURTHER * lack[close][:, None] * b / np.sum(b**2, 1, keepdims=True))
    return missing


def _sides(samples: Array, collider: Array, faces: Faces) -> tuple[Closest, Array]:
    """The nearest points of the collider, and +1 outside or −1 inside [p]."""
    near = closest_points(samples, collider, faces)
    n = vertex_normals(collider, faces)
    outward = np.einsum("pk,pkc->pc", near.barycentric, n[faces[near.face]])
    return near, np.sign(np.sum((samples - near.point) * outward, 1))
