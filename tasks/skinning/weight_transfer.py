"""Skin weights of a body given to a clothed surface: copied where the surfaces agree, inpainted elsewhere.

A vertex is *matched* when the closest point of the source surface is near and faces the same way; it takes that point's weights.
The weights w of the other vertices minimise, one joint at a time and with the matched vertices fixed,

    E(w) = wᵀ Q w,    Q = −L + L M⁻¹ L        (Dirichlet plus squared-Laplacian energy)

with L the cotangent Laplacian (negative semi-definite) and M the lumped areas, both of the tufted cover, so that boundaries,
non-manifold edges and poor triangles do no harm (Sharp & Crane 2020).

Source: Abdrashitov, Raichstat, Monsen & Hill, "Robust skin weights transfer via weight inpainting", SIGGRAPH Asia 2023 Technical
Communications, §3.1 (match) and §3.2 (inpainting).
Limits: Q is not scale-free: the squared Laplacian weighs 1/area, so vertices must be in metres to be comparable between meshes.
A piece without any matched vertex has no unique minimum (any constant will do): it takes the weights of its closest source points
and is reported.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, diags
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from tasks.geometry.distances import closest_points
from tasks.geometry.faults import Fault, refuse
from tasks.geometry.meshes import components, edges, vertex_normals

Array = NDArray[np.float64]
Faces = NDArray[np.int32]

DISTANCE = 0.05  # [-] of the target's bounding-box diagonal; the paper's released code
ANGLE = np.deg2rad(30)  # [rad] the paper's released code
SWEEPS, BLEND = 10, 0.2  # smoothing, the paper's released code


@dataclass(frozen=True)
class Skin:
    """weights [V, joint] (rows sum to 1); matched [V] bool; unmatched_pieces, each the vertices of a piece that matched nowhere; ending."""

    weights: Array
    matched: NDArray[np.bool_]
    unmatched_pieces: tuple[NDArray[np.int64], ...]
    ending: str


def transfer_weights(
    source_vertices: Array,
    source_faces: Faces,
    source_weights: Array,
    vertices: Array,
    faces: Faces,
    *,
    distance: float = DISTANCE,
    angle: float = ANGLE,
    two_sided: bool = False,
    smoothed: bool = False,
) -> Skin:
    """Weights for the surface (vertices [V, 3] m, faces [F, 3]) from a body in the same pose.

    The body: source_vertices [S, 3] m, source_faces, source_weights [S, joint] with rows that sum to 1. `distance` is a fraction
    of the target's bounding-box diagonal, `angle` [rad] lies between the normals. `two_sided` also accepts a normal that points
    the other way, for garments modelled with an inner layer; on a single sheet it would let the inside of a skirt match the far
    thigh, hence off. `smoothed` adds the paper's optional averaging around inpainted vertices.
    Raises BadInput on arrays that do not fit together or are not finite.
    """
    refuse(_faults(source_vertices, source_faces, source_weights, vertices, faces))
    radius = distance * np.linalg.norm(np.ptp(vertices[np.unique(faces)], axis=0))
    copied, matched = match(source_vertices, source_faces, source_weights, vertices, faces, radius=radius, angle=angle, two_sided=two_sided)
    piece = components(faces, len(vertices))
    anchored = np.isin(piece, piece[matched])
    weights = copied.copy()
    unknown = anchored & ~matched
    weights[unknown] = inpaint(vertices, faces, copied, matched)[unknown]
    weights = partition_of_unity(weights)
    if smoothed:
        weights = smooth(vertices, faces, weights, matched, radius=radius)
    lost = tuple(np.flatnonzero(piece == label) for label in np.unique(piece[~anchored]))
    return Skin(weights, matched, lost, _ending(matched, unknown, lost))


def match(
    source_vertices: Array,
    source_faces: Faces,
    source_weights: Array,
    vertices: Array,
    faces: Faces,
    *,
    radius: float,
    angle: float,
    two_sided: bool,
) -> tuple[Array, NDArray[np.bool_]]:
    """Weights of the closest source point [V, joint], and whether it is a match [V]: within `radius` [m] and `angle` [rad] (paper §3.1)."""
    near = closest_points(vertices, source_vertices, source_faces)
    corners = source_faces[near.face]
    blend = near.barycentric[:, :, None]
    normal = _unit((vertex_normals(source_vertices, source_faces)[corners] * blend).sum(1))
    cosine = np.sum(normal * vertex_normals(vertices, faces), axis=1)  # compared as a cosine: arccos of 1 + 1e-16 is NaN
    facing = np.abs(cosine) if two_sided else cosine
    return (source_weights[corners] * blend).sum(1), (near.distance <= radius) & (facing >= np.cos(angle))


def inpaint(vertices: Array, faces: Faces, weights: Array, fixed: NDArray[np.bool_]) -> Array:
    """Weights [V, joint] that minimise wᵀQw with the `fixed` [V] rows given (paper §3.2); rows of pieces without a fixed vertex stay."""
    piece = components(faces, len(vertices))
    free = np.isin(piece, piece[fixed]) & ~fixed
    result = weights.copy()
    if free.any():
        Q = inpainting_energy(vertices, faces)
        result[free] = splu(Q[free][:, free].tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(
            -(Q[free][:, fixed] @ weights[fixed])
        )
    return result


def inpainting_energy(vertices: Array, faces: Faces):
    """Q = −L + L M⁻¹ L [V, V] sparse, with the tufted Laplacian; rows of vertices without a face are empty."""
    import robust_laplacian

    used, local = np.unique(faces, return_inverse=True)
    stiffness, M = robust_laplacian.mesh_laplacian(np.ascontiguousarray(vertices[used], float), local.reshape(-1, 3).astype(np.int64))
    Q = (stiffness + stiffness @ diags(1 / M.diagonal()) @ stiffness).tocoo()  # the package's matrix is −L
    return coo_matrix((Q.data, (used[Q.row], used[Q.col])), shape=(len(vertices), len(vertices))).tocsr()


def smooth(vertices: Array, faces: Faces, weights: Array, matched: NDArray[np.bool_], *, radius: float) -> Array:
    """Weights averaged with their neighbours', 10 sweeps of 0.2, at unmatched vertices and within `radius` [m] of one in the same piece.

    All vertices are updated at once. (The paper's released code updates in place, so that its result depends on the vertex order.)
    """
    e = edges(faces)
    both = np.concatenate([e, e[:, ::-1]])
    degree = np.bincount(both[:, 0], minlength=len(vertices))
    mean = coo_matrix((1.0 / degree[both[:, 0]], (both[:, 0], both[:, 1])), shape=(len(vertices),) * 2).tocsr()
    moving = _near_unmatched(vertices, components(faces, len(vertices)), matched, radius) & (degree > 0)
    for _ in range(SWEEPS):
        weights = np.where(moving[:, None], (1 - BLEND) * weights + BLEND * (mean @ weights), weights)
    return weights


def partition_of_unity(weights: Array) -> Array:
    """Weights clipped to ≥ 0 and rows scaled to sum 1: the squared Laplacian overshoots, skinning must not."""
    w = np.clip(weights, 0, None)
    return w / w.sum(1, keepdims=True)


def _near_unmatched(vertices: Array, piece: NDArray[np.int32], matched: NDArray[np.bool_], radius: float) -> NDArray[np.bool_]:
    near = ~matched
    for label in np.unique(piece[~matched]):
        here = np.flatnonzero(piece == label)
        distance, _ = cKDTree(vertices[here[~matched[here]]]).query(vertices[here])
        near[here] |= distance < radius
    return near


def _ending(matched: NDArray[np.bool_], inpainted: NDArray[np.bool_], lost: tuple[NDArray[np.int64], ...]) -> str:
    told = f"{matched.sum()} vertices matched, {inpainted.sum()} inpainted"
    if not lost:
        return told
    count = sum(len(piece) for piece in lost)
    return f"{told}; {len(lost)} pieces ({count} vertices) match the body nowhere and took its closest weights: check that they belong"


def _unit(a: Array) -> Array:
    length = np.linalg.norm(a, axis=1, keepdims=True)
    return np.divide(a, length, out=np.zeros_like(a), where=length > 0)


def _faults(source_vertices: Array, source_faces: Faces, source_weights: Array, vertices: Array, faces: Faces) -> list[Fault]:
    faults = []
    for name, x, f in (("source", source_vertices, source_faces), ("target", vertices, faces)):
        if not np.isfinite(x).all():
            faults.append(Fault(f"{name} vertices", f"{(~np.isfinite(x).all(1)).sum()} are not finite", "Give every vertex a position."))
        if len(f) == 0 or f.max() >= len(x):
            faults.append(
                Fault(f"{name} faces", f"{len(f)} faces over {len(x)} vertices do not fit together", "Give the faces of these vertices.")
            )
    if len(source_weights) != len(source_vertices):
        faults.append(
            Fault("source_weights", f"{len(source_weights)} rows for {len(source_vertices)} vertices", "Give one row per vertex.")
        )
    elif not np.allclose(source_weights.sum(1), 1, atol=1e-3) or source_weights.min() < 0:
        faults.append(Fault("source_weights", "rows are negative or do not sum to 1", "Normalise the body's skin weights."))
    return faults
