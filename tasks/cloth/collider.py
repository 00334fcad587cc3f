"""The body as collider: its skin near the garment, decimated, and drawn in where the fitted body pokes through the garment it wears.

A fitted body is off by millimetres to a centimetre and ignores flattened flesh, while contact needs a start without intersections. Where a
point of the garment lies closer than the clearance or inside, the three corners of the nearest body face are drawn in along their normals
by what is missing, spread to the neighbours, until nothing is closer. One depth per vertex serves all frames, so the collider moves as the
body does.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.distances import Closest, closest_points
from tasks.geometry.meshes import components, edges, submesh, vertex_normals

Array = NDArray[np.float64]
Faces = NDArray[np.int32]

CLEARANCE = 2.5e-3  # [m] more than the barrier distance
FASTENED_CLEARANCE = 6e-3  # [m] at driven nodes: neither they nor the body can give way, so nothing may come between them
REACH = 0.25  # [m] body farther from the garment than this in all frames is left out
DEEPEST = 0.03  # [m] a body that would have to give way further is not there: its faces are left out
LIMB = 0.05  # [m] deeper inside is another limb's cloth, not a fit error
ROUNDS = 30
FACES = 2400  # contact costs grow with both meshes: triangles no finer than the cloth's


@dataclass(frozen=True)
class FittedCollider:
    """motion [T, C, 3] m, faces [G, 3], and how far each vertex was drawn in [C] m."""

    motion: Array
    faces: Faces
    drawn_in: Array


def fitted_collider(body: Array, body_faces: Faces, garment: Array, garment_faces: Faces, *, fastened: Faces) -> FittedCollider:
    """The collider for a garment [T, V, 3] m, driven at the nodes `fastened` [B], on a body [T, C, 3] m; clear of the tracked garment in every frame."""
    motion, faces = _decimated(*_near(*_skin(body, body_faces), garment))
    depth = np.zeros(motion.shape[1])
    normals = np.stack([vertex_normals(x, faces) for x in motion])
    e = edges(faces)
    driven = np.isin(np.arange(garment.shape[1]), fastened).astype(float)[:, None]
    clearance = np.where(_samples(driven, garment_faces)[:, 0] > 0, FASTENED_CLEARANCE, CLEARANCE)
    for t in range(len(motion)):
        depth = _cleared(_samples(garment[t], garment_faces), clearance, motion[t], normals[t], faces, e, depth)
    own, kept = submesh(faces, depth < DEEPEST)
    return FittedCollider((motion - depth[None, :, None] * normals)[:, kept], own, depth[kept])


def deepest_poke(body: Array, body_faces: Faces, garment: Array) -> float:
    """How far [m] the garment [T, V, 3] m reaches into the body [T, C, 3] m at most; what is `LIMB` deep lies on another limb."""
    deepest = 0.0
    for x, b in zip(garment, body):
        near, side = _sides(x, b, body_faces)
        inside = (side < 0) & (near.distance < LIMB)
        deepest = max(deepest, float(near.distance[inside].max(initial=0.0)))
    return deepest


def _cleared(samples: Array, clearance: Array, body: Array, normals: Array, faces: Faces, e: Faces, depth: Array) -> Array:
    """`depth` [C] increased until the samples [n, 3] m of one frame are clear."""
    for _ in range(ROUNDS):
        missing = _missing(samples, clearance, body - depth[:, None] * normals, faces)
        if missing.max() <= 0:
            break
        depth = np.minimum(depth + _spread(missing, e), DEEPEST)
    return depth


def _skin(body: Array, faces: Faces) -> tuple[Array, Faces]:
    """The largest piece: eyes and teeth are pieces of their own."""
    label = components(faces, body.shape[1])
    own, kept = submesh(faces, label == np.argmax(np.bincount(label)))
    return body[:, kept], own


def _near(body: Array, faces: Faces, garment: Array) -> tuple[Array, Faces]:
    from scipy.spatial import cKDTree

    keep = np.zeros(body.shape[1], bool)
    for t in range(0, len(body), 4):
        keep |= cKDTree(garment[t]).query(body[t], distance_upper_bound=REACH)[0] < REACH
    own, kept = submesh(faces, keep)
    return body[:, kept], own


def _decimated(body: Array, faces: Faces) -> tuple[Array, Faces]:
    """At most `FACES` triangles by edge collapse in frame 0 (Garland & Heckbert 1997), carried by the skin they lie on."""
    import igl

    if len(faces) <= FACES:
        return body, faces
    manifold, corner = igl.split_nonmanifold(
        faces.astype(np.int64)
    )  # qslim returns nothing where the patch's rim touches itself in a vertex
    x, light, *_ = igl.qslim(np.asfortranarray(body[0][corner]), np.asfortranarray(manifold), FACES, True)
    on = closest_points(np.ascontiguousarray(x), body[0], faces)
    return np.einsum("nk,tnkc->tnc", on.barycentric, body[:, faces[on.face]]), np.ascontiguousarray(light, dtype=np.int32)


def _samples(x: Array, faces: Faces) -> Array:
    e = edges(faces)
    return np.concatenate([x, x[faces].mean(1), x[e].mean(1)])


def _missing(samples: Array, clearance: Array, collider: Array, faces: Faces) -> Array:
    """How much deeper each collider vertex must lie [C] m for the samples to be clear of it."""
    near, side = _sides(samples, collider, faces)
    lack = clearance - side * near.distance
    close = (lack > 0) & (near.distance < LIMB)
    missing = np.zeros(len(collider))
    np.maximum.at(missing, faces[near.face[close]], lack[close][:, None] * 1.05)
    return missing


def _sides(samples: Array, collider: Array, faces: Faces) -> tuple[Closest, Array]:
    """The nearest points of the collider, and +1 outside or −1 inside [p]."""
    near = closest_points(samples, collider, faces)
    n = vertex_normals(collider, faces)
    outward = np.einsum("pk,pkc->pc", near.barycentric, n[faces[near.face]])
    return near, np.sign(np.sum((samples - near.point) * outward, 1))


def _spread(missing: Array, e: Faces) -> Array:
    out = missing.copy()
    for _ in range(2):
        np.maximum.at(out, e[:, 0], 0.5 * out[e[:, 1]])
        np.maximum.at(out, e[:, 1], 0.5 * out[e[:, 0]])
    return out
