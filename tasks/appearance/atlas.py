"""The texture plane: which texel belongs to which chart, and how a point of the surface reads texels.

Texel (row i, column j) of a texture [h, w] has its centre at u = (j + ½)/w, v = 1 − (i + ½)/h: row 0 is the top of the image that
is saved, and v points up as in OBJ files. A *chart* is a connected piece of the UV mesh. Every chart owns the texels it covers and
a gutter around them, so that a bilinear look-up near its border never needs a texel of nobody.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from tasks.geometry.faults import Fault
from tasks.geometry.meshes import components
from tasks.geometry.rasterise import rasterise

Array = NDArray[np.float64]
Faces = NDArray[np.int32]

GUTTER = 3  # [texel] a bilinear look-up reaches √2 past the border; a sliver may miss one texel centre more
SUBFACES = 4  # face means are taken over SUBFACES² congruent triangles


def texel_coordinates(uv: Array, size: tuple[int, int]) -> Array:
    """(column, row) in texels [..., 2] of uv [..., 2] for a texture of size (height, width); integers are texel centres."""
    height, width = size
    return np.stack([uv[..., 0] * width - 0.5, (1 - uv[..., 1]) * height - 0.5], -1)


def chart_of_texels(uv_vertices: Array, uv_faces: Faces, size: tuple[int, int]) -> NDArray[np.int32]:
    """Chart number of each texel [h, w], gutters included; −1 where no chart is near."""
    face, _ = texel_surface(uv_vertices, uv_faces, size)
    label = components(uv_faces, len(uv_vertices))[uv_faces[:, 0]]
    chart = np.where(face >= 0, label[face], -1).astype(np.int32)
    distance, nearest = distance_transform_edt(chart < 0, return_indices=True)
    return np.where(distance <= GUTTER, chart[tuple(nearest)], -1)


def texel_surface(uv_vertices: Array, uv_faces: Faces, size: tuple[int, int]) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Face [h, w] (−1 none) and barycentric coordinates [h, w, 3] of the surface point at each texel centre."""
    height, width = size
    plane = np.column_stack([uv_vertices[:, 0], 1 - uv_vertices[:, 1], np.ones(len(uv_vertices))])
    drawn = rasterise(np.diag([width, height, 1.0]), np.eye(3), np.zeros(3), (width, height), plane, uv_faces)
    return drawn.face, drawn.barycentric


def sample(texture: Array, uv: Array) -> Array:
    """Bilinear look-up [..., channel] of a texture [h, w, channel] at uv [..., 2]; clamped at the border of the image."""
    height, width = texture.shape[:2]
    x = texel_coordinates(uv, (height, width))
    corner = np.clip(np.floor(x), 0, [width - 2, height - 2]).astype(int)
    fx, fy = np.moveaxis(np.clip(x - corner, 0, 1), -1, 0)[..., None]
    j, i = corner[..., 0], corner[..., 1]
    top = (1 - fx) * texture[i, j] + fx * texture[i, j + 1]
    return (1 - fy) * top + fy * ((1 - fx) * texture[i + 1, j] + fx * texture[i + 1, j + 1])


def face_means(texture: Array, uv_vertices: Array, uv_faces: Faces) -> Array:
    """Mean colour of each face [F, channel] over the centres of 16 congruent sub-triangles."""
    barycentric = _subface_centres(SUBFACES)
    return sample(texture, np.einsum("sk,fkc->fsc", barycentric, uv_vertices[uv_faces])).mean(1)


def uv_faults(uv_vertices: Array, uv_faces: Faces, face_count: int) -> list[Fault]:
    """What makes a UV map unfit: none at all, another number of faces than the mesh, or coordinates outside the unit square (tiling)."""
    if not len(uv_vertices):
        return [Fault("uv_vertices", "there are none", "Unwrap the mesh.")]
    faults = []
    if len(uv_faces) != face_count:
        faults.append(Fault("uv_faces", f"{len(uv_faces)} faces for {face_count} of the mesh", "Give one UV triangle per face."))
    if not (np.isfinite(uv_vertices).all() and uv_vertices.min() >= 0 and uv_vertices.max() <= 1):
        low, high = uv_vertices.min(0).tolist(), uv_vertices.max(0).tolist()
        faults.append(Fault("uv_vertices", f"they span {low} to {high}", "Pack the charts into [0, 1]², or unwrap the mesh anew."))
    return faults


def _subface_centres(n: int) -> Array:
    """Barycentric centres [n², 3] of the n² congruent parts of a triangle."""
    i, j = np.meshgrid(np.arange(n), np.arange(n))
    upright, inverted = i + j < n, i + j < n - 1
    a = np.concatenate([i[upright] + 1 / 3, i[inverted] + 2 / 3]) / n
    b = np.concatenate([j[upright] + 1 / 3, j[inverted] + 2 / 3]) / n
    return np.stack([1 - a - b, a, b], 1)
