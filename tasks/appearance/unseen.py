"""Colour for texels that no image determines: harmonic over the surface, from what was seen around them.

Filling within a chart stops at its seams and leaves whole small charts to the prior; the surface knows their neighbours. Each
vertex takes the mean of the observed texels of its faces; vertices without any solve Σ_j (c_i − c_j) = 0 over edges; texels
interpolate. A piece of which nothing was seen takes the mean observed colour.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_matrix, diags
from scipy.sparse.linalg import splu

from tasks.appearance.atlas import texel_surface
from tasks.geometry.meshes import components, edges

Array = NDArray[np.float64]
Faces = NDArray[np.int32]


def fill_unseen(
    albedo: NDArray[np.float32], observed: NDArray[np.bool_], faces: Faces, uv_vertices: Array, uv_faces: Faces, vertex_count: int
) -> NDArray[np.float32]:
    """The texture [h, w, 3] with its unobserved texels replaced; observed [h, w] ones are kept."""
    face, barycentric = texel_surface(uv_vertices, uv_faces, observed.shape)
    colour = _vertex_colours(albedo, observed & (face >= 0), face, barycentric, faces, vertex_count)
    on_surface = face >= 0
    filled = np.zeros_like(albedo)
    filled[on_surface] = np.einsum("nk,nkc->nc", barycentric[on_surface], colour[faces[face[on_surface]]])
    nearest = distance_transform_edt(~on_surface, return_distances=False, return_indices=True)
    return np.where(observed[..., None], albedo, filled[tuple(nearest)])


def _vertex_colours(albedo, source, face, barycentric, faces: Faces, vertex_count: int) -> Array:
    weight, total = np.zeros(vertex_count), np.zeros((vertex_count, 3))
    corner, b = faces[face[source]].ravel(), barycentric[source].astype(float)
    np.add.at(weight, corner, b.ravel())
    np.add.at(total, corner, (b[:, :, None] * albedo[source][:, None]).reshape(-1, 3))
    mean = total.sum(0) / max(weight.sum(), 1e-12) if source.any() else np.full(3, 0.5)
    seen = weight > 1e-3
    colour = np.where(seen[:, None], total / np.maximum(weight, 1e-3)[:, None], mean)
    return _harmonic(colour, seen, faces)


def _harmonic(colour: Array, fixed: NDArray[np.bool_], faces: Faces) -> Array:
    """Colours [V, 3] with the free vertices at the mean of their neighbours; pieces without a fixed vertex stay."""
    piece = components(faces, len(colour))
    free = ~fixed & np.isin(piece, piece[fixed])
    if not free.any():
        return colour
    e = edges(faces)
    W = coo_matrix((np.ones(len(e)), (e[:, 0], e[:, 1])), shape=(len(colour),) * 2).tocsr()
    L = diags(np.asarray((W + W.T).sum(1)).ravel()) - (W + W.T)
    colour = colour.copy()
    colour[free] = splu(L[free][:, free].tocsc()).solve(-(L[free][:, fixed] @ colour[fixed]))
    return colour
