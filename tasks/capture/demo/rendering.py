"""Pictures of the dressed actor: Mitsuba path tracing of two-sided diffuse surfaces under a constant sky of radiance 1.

One scene is kept; a frame moves its vertices and `params.update()` rebuilds the acceleration structure. The camera is one sensor per
picture size whose pose and lens are parameters, so that nothing is compiled again from camera to camera. With one Dr.Jit thread and a
seed for each camera and frame, the same picture comes out bit for bit; speed comes from several processes instead.

Mitsuba's camera looks along +z with +x to the left and +y up, ours along +z with +x right and +y down. Its principal point offset
is that of the picture's centre from the principal point, in fractions of the picture's size: the opposite sign of ours (measured).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.cameras import Cameras
from tasks.geometry.mitsuba_variant import load_mitsuba

Array = NDArray[np.float64]
Faces = NDArray[np.int32]

DEPTH = 4  # path vertices; deeper paths change a diffuse person under a white sky by less than one grey level


@dataclass(frozen=True)
class Surface:
    """Something to render: faces [F, 3] into a vertex array given per frame, with a texture in uv or colours at its vertices.

    texture [height, width, 3] and uv [V, 2] in [0, 1], v up; or colours [V, 3]. Both are linear albedos.
    """

    name: str
    faces: Faces
    uv: Array | None = None
    texture: NDArray[np.float32] | None = None
    colours: Array | None = None


class Renderer:
    """A scene with fixed topology and appearance. `move` sets the vertices of a frame, `render` takes the picture of one camera."""

    def __init__(self, surfaces: Sequence[Surface], vertices: Sequence[Array], *, spp: int = 16) -> None:
        self._mi = load_mitsuba(threads=1)
        self._names = [surface.name for surface in surfaces]
        meshes = {s.name: self._mesh(s, x) for s, x in zip(surfaces, vertices, strict=True)}
        self._scene = self._mi.load_dict(
            {"type": "scene", "sky": {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}}, **meshes}
        )
        self._params = self._mi.traverse(self._scene)
        self._integrator = self._mi.load_dict({"type": "path", "max_depth": DEPTH, "hide_emitters": True})
        self._sensors: dict = {}
        self._spp = spp

    def move(self, vertices: Sequence[Array]) -> None:
        """Put the surfaces where vertices [surface][V, 3] m say, in the order of construction."""
        for name, x in zip(self._names, vertices, strict=True):
            self._params[f"{name}.vertex_positions"] = self._mi.Float(np.ascontiguousarray(x, np.float32).ravel())
        self._params.update()

    def render(self, cameras: Cameras, k: int, *, seed: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Linear colour [height, width, 3], black where nothing is, and coverage [height, width] in [0, 1], as camera k sees it."""
        picture = self._mi.render(self._scene, sensor=self._sensor(cameras, k), integrator=self._integrator, spp=self._spp, seed=seed)
        rgba = np.array(picture, np.float32)
        return rgba[..., :3], np.clip(rgba[..., 3], 0, 1)

    def _sensor(self, cameras: Cameras, k: int):
        width, height = (int(n) for n in cameras.size[k])
        if (width, height) not in self._sensors:
            self._sensors[width, height] = self._mi.load_dict(_sensor_dict(width, height))
        sensor, K = self._sensors[width, height], cameras.K[k]
        params = self._mi.traverse(sensor)
        params["to_world"] = self._mi.Transform4f(_to_world(cameras, k))
        params["x_fov"] = self._mi.Float(float(np.degrees(2 * np.arctan(width / (2 * K[0, 0])))))
        params["principal_point_offset_x"] = self._mi.Float(float(0.5 - K[0, 2] / width))
        params["principal_point_offset_y"] = self._mi.Float(float(0.5 - K[1, 2] / height))
        params.update()
        return sensor

    def _mesh(self, surface: Surface, x: Array):
        mi = self._mi
        props = mi.Properties()
        props["bsdf"] = mi.load_dict({"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": self._reflectance(surface)}})
        mesh = mi.Mesh(
            surface.name, len(x), len(surface.faces), has_vertex_normals=True, has_vertex_texcoords=surface.uv is not None, props=props
        )
        if surface.colours is not None:
            mesh.add_attribute("vertex_color", 3, np.ascontiguousarray(surface.colours, np.float32).ravel())
        params = mi.traverse(mesh)
        params["vertex_positions"] = mi.Float(np.ascontiguousarray(x, np.float32).ravel())
        params["faces"] = mi.UInt32(np.ascontiguousarray(surface.faces, np.uint32).ravel())
        if surface.uv is not None:
            params["vertex_texcoords"] = mi.Float(np.ascontiguousarray(surface.uv, np.float32).ravel())
        params.update()
        return mesh

    def _reflectance(self, surface: Surface) -> dict:
        if surface.texture is None:
            return {"type": "mesh_attribute", "name": "vertex_color"}
        picture = np.ascontiguousarray(surface.texture[::-1], np.float32)  # row 0 of a bitmap is v = 0 in mitsuba
        return {"type": "bitmap", "bitmap": self._mi.Bitmap(picture), "raw": True, "wrap_mode": "clamp"}


def _sensor_dict(width: int, height: int) -> dict:
    film = {
        "type": "hdrfilm",
        "width": width,
        "height": height,
        "pixel_format": "rgba",
        "component_format": "float32",
        "rfilter": {"type": "box"},
    }
    return {"type": "perspective", "fov": 40.0, "fov_axis": "x", "near_clip": 0.05, "film": film, "sampler": {"type": "multijitter"}}


def _to_world(cameras: Cameras, k: int) -> Array:
    T = np.eye(4)
    T[:3, :3] = cameras.R[k].T @ np.diag([-1.0, -1.0, 1.0])
    T[:3, 3] = -cameras.R[k].T @ cameras.t[k]
    return T
