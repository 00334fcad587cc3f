"""Pictures of a textured mesh in motion: quick ones from the pixel model, final ones from the path tracer.

Both show diffuse cloth under the constant light of the fit, on a transparent background, as 8-bit sRGB with straight alpha.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from tasks.appearance.colour import srgb8_from_linear
from tasks.appearance.observations import camera_faults
from tasks.appearance.path_tracer import FINAL_SAMPLES, PathTracer
from tasks.appearance.pixels import shade
from tasks.appearance.scene import Scene, scene_faults
from tasks.appearance.transport import RAYS
from tasks.geometry.faults import refuse

Picture = NDArray[np.uint8]  # [height, width, 4]


def render(
    scene: Scene, albedo: NDArray, *, cameras: Sequence[int] | None = None, rays: int = RAYS, seed: int = 0
) -> Iterator[tuple[int, int, Picture]]:
    """(frame, camera, picture) for every frame of the scene and the given cameras (all by default), by rasterisation. Raises BadInput."""
    refuse(scene_faults(scene.vertices, scene.faces, scene.uv_vertices, scene.uv_faces) + camera_faults(scene.cameras, 1))
    chosen = range(len(scene.cameras)) if cameras is None else cameras
    light = scene.light(scene.trace(rays=rays, seed=seed), albedo)
    for frame in range(len(scene.vertices)):
        for camera in chosen:
            image, covered = shade(scene.view(frame, camera, light[frame], albedo.shape[:2]), albedo)
            yield frame, camera, _picture(image, covered)


def render_final(
    scene: Scene, albedo: NDArray, *, cameras: Sequence[int] | None = None, samples: int = FINAL_SAMPLES, variant: str = "llvm_ad_rgb"
) -> Iterator[tuple[int, int, Picture]]:
    """The same by path tracing with `samples` per pixel (supplement A.4: 128): shadows as fine as the mesh. Raises BadInput."""
    refuse(scene_faults(scene.vertices, scene.faces, scene.uv_vertices, scene.uv_faces))
    tracer = PathTracer(scene.cameras, scene.vertices[0], scene.faces, scene.uv_vertices, scene.uv_faces, albedo, variant=variant)
    for frame, vertices in enumerate(scene.vertices):
        tracer.move(vertices)
        for camera in range(len(scene.cameras)) if cameras is None else cameras:
            drawn = tracer.render(camera, samples=samples)
            yield frame, camera, _picture(drawn[..., :3], drawn[..., 3])


def _picture(premultiplied: NDArray, covered: NDArray) -> Picture:
    colour = premultiplied / np.maximum(covered, 1e-6)[..., None]
    alpha = np.rint(255 * np.clip(covered, 0, 1)).astype(np.uint8)
    return np.concatenate([srgb8_from_linear(colour), alpha[..., None]], -1)
