"""A moving mesh as video: shaded by a lamp at the camera, textured if there is a texture.

Light: ρ (0.25 + 0.75 |n·d|), n the normal of the face and d the direction of view; a sketch to look at, not a rendering to compare.
Codec: VP9 in MP4, which browsers play. The OpenCV wheel carries no H.264 encoder, and MPEG-4 part 2, which it has, plays in none.

Limits: nearest texel; no shadows.
"""

from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.export.surface import Surface
from tasks.geometry.cameras import Cameras
from tasks.geometry.faults import BadInput, Fault
from tasks.geometry.meshes import face_normals
from tasks.geometry.rasterise import rasterise

CODEC = "vp09"
AMBIENT = 0.25
GREY = 176
WHITE = 255


def shaded(cameras: Cameras, camera: int, surface: Surface, vertices: NDArray, *, texture: NDArray | None = None) -> Iterator[NDArray]:
    """One image [height, width, 3] uint8 per frame of vertices [T, V, 3] m; texture [row, column, 3] uint8 sRGB. The lens is ideal."""
    K, R, t, size = (getattr(cameras, name)[camera] for name in ("K", "R", "t", "size"))
    for x in vertices:
        fragments = rasterise(K, R, t, size, x, surface.faces)
        hit = fragments.face >= 0
        face, barycentric = fragments.face[hit], fragments.barycentric[hit]
        colour = GREY if texture is None else _texels(surface, texture, face, barycentric)
        image = np.full((*hit.shape, 3), WHITE, np.uint8)
        image[hit] = colour * _lamp(x, surface.faces, eye=-R.T @ t)[face, None]
        yield image


def write_video(path: Path, images: Iterable[NDArray], *, fps: float) -> Path:
    """Writes images [height, width, 3] uint8 RGB, all of one size, as .mp4. Raises BadInput, OSError when the codec is missing."""
    images = iter(images)
    first = next(images, None)
    if first is None:
        raise BadInput([Fault(str(path), "would have no frame", "give at least one image")])
    height, width = _even(first).shape[:2]
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*CODEC), fps, (width, height))
    if not video.isOpened():
        raise OSError(f"{path}: OpenCV cannot write {CODEC}; install opencv-contrib-python-headless as pinned in constraints.txt")
    try:
        for image in chain([first], images):
            video.write(cv2.cvtColor(_even(image), cv2.COLOR_RGB2BGR))
    finally:
        video.release()
    return path


def _even(image: NDArray) -> NDArray:
    """The codec halves its colours, so an odd width or height gets one more column or row, a copy of the last."""
    return np.pad(image, ((0, image.shape[0] % 2), (0, image.shape[1] % 2), (0, 0)), mode="edge")


def _texels(surface: Surface, texture: NDArray, face: NDArray, barycentric: NDArray) -> NDArray:
    uv = np.einsum("pc,pcd->pd", barycentric, surface.uv_vertices[surface.uv_faces[face]])
    rows, columns = texture.shape[:2]
    row = np.clip(((1 - uv[:, 1]) * rows).astype(int), 0, rows - 1)
    column = np.clip((uv[:, 0] * columns).astype(int), 0, columns - 1)
    return texture[row, column]


def _lamp(x: NDArray, faces: NDArray, *, eye: NDArray) -> NDArray:
    """Brightness of each face."""
    towards = eye - x[faces].mean(axis=1)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    return AMBIENT + (1 - AMBIENT) * np.abs((face_normals(x, faces) * towards).sum(axis=1))
