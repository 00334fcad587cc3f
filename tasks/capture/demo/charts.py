"""A texture atlas for the template: flat charts side by side in the unit square, all at one scale.

Garments keep the panels they were cut from. The body is cut where the dominant axis of its normals changes, and each piece is laid
along that axis (a box projection): no face is squeezed by more than 1/√3. Charts are set on shelves, tallest first.
"""

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.meshes import components, face_normals

Array = NDArray[np.float64]
Faces = NDArray[np.int32]

GUTTER = 0.012  # [m] between charts: at 1024 texels and 2 m to the side, six texels
SMOOTHING = 6  # sweeps of majority vote among neighbouring faces: fewer, larger charts
LEAST_FACING = 0.35  # a face may join a chart only if it faces that way by more than this cosine


def box_charts(vertices: Array, faces: Faces) -> tuple[Array, Faces]:
    """Charts of a surface: uv_vertices [U, 2] m (charts overlap until packed) and uv_faces [F, 3]; every chart is one component."""
    normals = face_normals(vertices, faces)
    axis = _majority(normals, faces)
    uv_vertices, uv_faces, count = [], np.empty_like(faces), 0
    for k in range(6):
        chosen = np.flatnonzero(axis == k)
        if not len(chosen):
            continue
        used, index = np.unique(faces[chosen], return_inverse=True)
        right, up = _plane(k)
        uv_vertices.append(np.stack([vertices[used] @ right, vertices[used] @ up], 1))
        uv_faces[chosen] = index.reshape(-1, 3) + count
        count += len(used)
    return np.concatenate(uv_vertices), uv_faces


def pack(uv_vertices: Array, uv_faces: Faces) -> Array:
    """The charts (components of uv_faces) moved apart and scaled together into the unit square; [U, 2], u to the right, v up."""
    label = components(uv_faces, len(uv_vertices))
    boxes = [(uv_vertices[label == c].min(0), uv_vertices[label == c].max(0)) for c in range(label.max() + 1)]
    sizes = np.array([high - low for low, high in boxes]) + GUTTER
    side = np.sqrt(sizes.prod(1).sum())
    while (corners := _shelves(sizes, side)) is None:
        side *= 1.02
    shift = np.array([corner - low for corner, (low, _) in zip(corners, boxes)])
    return (uv_vertices + shift[label] + GUTTER / 2) / side


def _shelves(sizes: Array, side: float) -> Array | None:
    """Lower left corners [chart, 2] of boxes on shelves within a square, or None where they do not fit."""
    corners, at, shelf, height = np.empty_like(sizes), 0.0, 0.0, 0.0
    for c in np.argsort(-sizes[:, 1], kind="stable"):
        if at + sizes[c, 0] > side:
            at, shelf, height = 0.0, shelf + height, 0.0
        corners[c] = at, shelf
        at, height = at + sizes[c, 0], max(height, sizes[c, 1])
        if at > side or shelf + height > side:
            return None
    return corners


def _majority(normals: Array, faces: Faces) -> NDArray[np.int64]:
    """Axis 0-5 (+x −x +y −y +z −z) of each face: its own, then again and again the commonest among itself and its neighbours."""
    facing = np.concatenate([normals, -normals], 1)[:, [0, 3, 1, 4, 2, 5]]
    a, b = _neighbours(faces)
    axis = facing.argmax(1)
    for _ in range(SMOOTHING):
        votes = 1.5 * np.eye(6)[axis]
        np.add.at(votes, a, np.eye(6)[axis[b]])
        np.add.at(votes, b, np.eye(6)[axis[a]])
        axis = np.where(facing > LEAST_FACING, votes, -1).argmax(1)
    return axis


def _neighbours(faces: Faces) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    half = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    order = np.lexsort(half.T)
    same = np.flatnonzero((half[order][1:] == half[order][:-1]).all(1))
    return order[same] % len(faces), order[same + 1] % len(faces)


def _plane(k: int) -> tuple[Array, Array]:
    """Right and up of someone who looks at the face from outside, so that charts are not mirrored."""
    out = np.eye(3)[k // 2] * (1 if k % 2 == 0 else -1)
    up = np.array([0.0, 1.0, 0.0]) if k // 2 != 1 else np.array([0.0, 0.0, -1.0 if k % 2 == 0 else 1.0])
    return np.cross(up, out), up
