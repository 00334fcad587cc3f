"""A textured mesh in motion, the rig that sees it, and the light on it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.appearance.atlas import face_means, uv_faults
from tasks.appearance.pixels import View, draw
from tasks.appearance.radiosity import irradiance
from tasks.appearance.ray_tracer import RayTracer
from tasks.appearance.transport import Hits, trace_transport
from tasks.geometry.cameras import Cameras
from tasks.geometry.faults import Fault

Array = NDArray[np.float64]
Faces = NDArray[np.int32]


@dataclass(frozen=True)
class Scene:
    """vertices [frame, V, 3] m; faces [F, 3]; uv_vertices [U, 2] and their own faces uv_faces [F, 3]; cameras without distortion."""

    vertices: Array
    faces: Faces
    uv_vertices: Array
    uv_faces: Faces
    cameras: Cameras

    def trace(self, *, rays: int, seed: int = 0) -> list[Hits]:
        """Transport of every frame: what the rays of each node meet."""
        tracer = RayTracer(self.faces, self.vertices.shape[1])
        return [trace_transport(tracer, x, self.faces, rays=rays, seed=seed) for x in self.vertices]

    def light(self, hits: list[Hits], albedo: NDArray) -> list[NDArray[np.float32]]:
        """Irradiance [node, 3] of every frame when the mesh wears the texture `albedo` [h, w, 3]."""
        colour = face_means(albedo, self.uv_vertices, self.uv_faces)
        return [irradiance(h, self.faces, colour) for h in hits]

    def view(self, frame: int, camera: int, A: NDArray[np.float32], texture_size: tuple[int, int]) -> View:
        """Sub-samples of one image under irradiance A [node, 3]."""
        return draw(self.cameras, camera, self.vertices[frame], self.faces, A, self.uv_vertices[self.uv_faces], texture_size)


def scene_faults(vertices: Array, faces: Faces, uv_vertices: Array, uv_faces: Faces) -> list[Fault]:
    """What keeps a moving textured mesh from being rendered."""
    faults = uv_faults(uv_vertices, uv_faces, len(faces))
    if vertices.ndim != 3 or vertices.shape[-1] != 3 or not len(vertices):
        faults.append(Fault("vertices", f"shape {vertices.shape}", "Give [frame, vertex, 3] in metres, one frame at least."))
    elif not np.isfinite(vertices).all():
        frame, vertex = np.argwhere(~np.isfinite(vertices).all(-1))[0].tolist()
        faults.append(Fault("vertices", f"not finite, first at frame {frame}, vertex {vertex}", "Leave that frame out or complete it."))
    return faults
