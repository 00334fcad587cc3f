"""The surface to export: one welded mesh with its own texture coordinates."""

from dataclasses import dataclass

from numpy.typing import NDArray


@dataclass(frozen=True)
class Surface:
    """vertices [V, 3] m at rest, faces [F, 3]; uv_vertices [U, 2] (v up), uv_faces [F, 3] into them."""

    vertices: NDArray
    faces: NDArray
    uv_vertices: NDArray
    uv_faces: NDArray
