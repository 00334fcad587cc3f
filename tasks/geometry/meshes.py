"""Triangle meshes: topology, normals, areas, and what can be wrong with one.

vertices [V, 3] m, faces [F, 3] vertex indices, counter-clockwise seen from outside.
"""

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.faults import Fault

Array = NDArray[np.float64]
Faces = NDArray[np.int32]


def edges(faces: Faces) -> Faces:
    """Undirected edges [E, 2], each once, smaller vertex first, sorted."""
    half, n = np.sort(_half_edges(faces), axis=1).astype(np.int64), int(faces.max(initial=0)) + 1
    return np.stack(np.divmod(np.unique(half[:, 0] * n + half[:, 1]), n), 1).astype(np.int32)


def edge_lengths(vertices: Array, edges: Faces) -> Array:
    """Lengths [E] m of edges [E, 2] between vertices [V, 3] m."""
    return np.linalg.norm(vertices[edges[:, 1]] - vertices[edges[:, 0]], axis=1)


def hinges(faces: Faces) -> Faces:
    """Interior edges with their opposite corners [H, 4] = (a, b, c, d): face (a, b, c) on one side, face (b, a, d) on the other."""
    half, opposite = _half_edges(faces), np.concatenate([faces[:, 2], faces[:, 0], faces[:, 1]])
    n = int(faces.max()) + 1 if len(faces) else 0
    forward = half[:, 0].astype(np.int64) * n + half[:, 1]
    backward = half[:, 1].astype(np.int64) * n + half[:, 0]
    order = np.argsort(forward)
    at = np.minimum(np.searchsorted(forward[order], backward), max(len(order) - 1, 0))
    twin = order[at]
    paired = (forward[twin] == backward) & (half[:, 0] < half[:, 1])
    return np.column_stack([half[paired], opposite[paired], opposite[twin[paired]]]).astype(np.int32)


def boundary_edges(faces: Faces) -> Faces:
    """Directed edges [B, 2] that belong to one face only."""
    half = _half_edges(faces)
    _, inverse, count = np.unique(np.sort(half, axis=1), axis=0, return_inverse=True, return_counts=True)
    return half[count[inverse.ravel()] == 1].astype(np.int32)


def components(faces: Faces, vertex_count: int) -> NDArray[np.int32]:
    """Label of the connected piece of every vertex [V], numbered from 0; a vertex of no face is its own piece."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    e = edges(faces)
    graph = coo_matrix((np.ones(len(e)), (e[:, 0], e[:, 1])), shape=(vertex_count, vertex_count))
    return connected_components(graph, directed=False)[1].astype(np.int32)


def face_normals(vertices: Array, faces: Faces) -> Array:
    """Unit normals [..., F, 3] of vertices [..., V, 3]; zero where a face has no area."""
    return _unit(_area_vectors(vertices, faces))


def face_areas(vertices: Array, faces: Faces) -> Array:
    """Areas [..., F] m²."""
    return np.linalg.norm(_area_vectors(vertices, faces), axis=-1) / 2


def vertex_normals(vertices: Array, faces: Faces) -> Array:
    """Area-weighted unit normals [V, 3] of vertices [V, 3]."""
    return _unit(_scatter(np.repeat(_area_vectors(vertices, faces), 3, axis=0), faces, len(vertices)))


def vertex_areas(vertices: Array, faces: Faces) -> Array:
    """A third of the area of the faces around each vertex [V] m²."""
    return _scatter(np.repeat(face_areas(vertices, faces), 3) / 3, faces, len(vertices))


def weld(vertices: Array, tolerance: float) -> tuple[Array, NDArray[np.int32]]:
    """One vertex for all that lie within `tolerance` [m] of one another: (vertices [W, 3], index [V] into them)."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    pairs = cKDTree(vertices).query_pairs(tolerance, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(vertices), len(vertices)))
    label = connected_components(graph, directed=False)[1]
    first, index = np.unique(label, return_index=True)[1], label
    order = np.argsort(first)  # keep the order in which the vertices came
    rank = np.empty(len(order), np.int32)
    rank[order] = np.arange(len(order))
    return vertices[first[order]], rank[index]


def submesh(faces: Faces, keep: NDArray[np.bool_]) -> tuple[Faces, NDArray[np.int32]]:
    """Faces whose corners are all kept, renumbered, and the old numbers of the vertices kept; keep [V] bool."""
    kept = np.flatnonzero(keep).astype(np.int32)
    number = np.full(len(keep), -1, np.int32)
    number[kept] = np.arange(len(kept))
    return number[faces[keep[faces].all(1)]], kept


def mesh_faults(vertices: Array, faces: Faces, name: str, *, metres: bool = True) -> list[Fault]:
    """What makes (vertices [V, 3], faces [F, 3]) unfit as a surface; `metres` adds the check of the unit.

    Vertices of no face are allowed: templates and colliders may have them. What has mass asks `loose_vertex_faults` besides.
    """
    faults = _array_faults(vertices, faces, name)
    if faults or not len(faces):
        return faults
    area = face_areas(vertices, faces)
    scale = np.linalg.norm(np.ptp(vertices, axis=0))
    flat = np.flatnonzero(area <= 1e-12 * scale**2)
    if len(flat):
        faults.append(
            Fault(name, f"{len(flat)} faces have no area, the first is face {flat[0]} {faces[flat[0]].tolist()}", "Delete or re-mesh them.")
        )
    faults += _topology_faults(faces, name)
    if metres and not 0.02 < scale < 20:
        faults.append(Fault(name, f"its bounding box has a diagonal of {scale:.4g} m", "Lengths must be in metres; rescale the file."))
    return faults


def loose_vertex_faults(faces: Faces, vertex_count: int, name: str) -> list[Fault]:
    """Vertices that belong to none of the faces [F, 3]: in a garment they have no mass, and no step of a simulation can place them."""
    loose = np.setdiff1d(np.arange(vertex_count), faces)
    return [Fault(name, f"{len(loose)} vertices belong to no face, the first is {loose[0]}", "Remove them.")] if len(loose) else []


def _array_faults(vertices: Array, faces: Faces, name: str) -> list[Fault]:
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        return [Fault(name, f"vertices {vertices.shape}, faces {faces.shape}", "Expected [V, 3] and [F, 3] (triangles only).")]
    faults = []
    if not len(faces):
        faults.append(Fault(name, "it has no faces", "Give a triangle mesh."))
    bad = np.flatnonzero(~np.isfinite(vertices).all(1))
    if len(bad):
        faults.append(Fault(name, f"{len(bad)} vertices are not finite, the first is vertex {bad[0]}", "Repair or remove them."))
    wild = np.flatnonzero(((faces < 0) | (faces >= len(vertices))).any(1))
    if len(wild):
        f = wild[0]
        faults.append(Fault(name, f"face {f} names vertices {faces[f].tolist()} but there are {len(vertices)}", "Repair the face list."))
    return faults


def _topology_faults(faces: Faces, name: str) -> list[Fault]:
    half = _half_edges(faces)
    undirected, inverse, count = np.unique(np.sort(half, axis=1), axis=0, return_inverse=True, return_counts=True)
    faults = []
    crowded = np.flatnonzero(count > 2)
    if len(crowded):
        e = undirected[crowded[0]].tolist()
        faults.append(
            Fault(
                name,
                f"{len(crowded)} edges have more than two faces, the first is {e}",
                "Make the surface manifold (split or delete faces).",
            )
        )
    paired = half[count[inverse.ravel()] == 2]
    once, directed = np.unique(paired, axis=0, return_counts=True)
    clash = once[directed > 1]
    if len(clash):
        faults.append(
            Fault(
                name,
                f"{len(clash)} edges run the same way in both faces, the first is {clash[0].tolist()}",
                "Orient all faces the same way round.",
            )
        )
    return faults


def _half_edges(faces: Faces) -> Faces:
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def _area_vectors(vertices: Array, faces: Faces) -> Array:
    a, b, c = (vertices[..., faces[:, k], :] for k in range(3))
    return np.cross(b - a, c - a)


def _unit(a: Array) -> Array:
    length = np.linalg.norm(a, axis=-1, keepdims=True)
    return np.divide(a, length, out=np.zeros_like(a), where=length > 0)


def _scatter(values: Array, faces: Faces, vertex_count: int) -> Array:
    at = faces.ravel()
    if values.ndim == 1:
        return np.bincount(at, values, vertex_count)
    return np.stack([np.bincount(at, each, vertex_count) for each in values.T], -1)
