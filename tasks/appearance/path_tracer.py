"""The same scene for Mitsuba 3: the textured mesh under constant light, seen by the rig.

Diffuse, two-sided, constant emitter of unit radiance, film with a box filter, so that it is the model of `pixels.py` but for how finely
irradiance is resolved. One scene serves all frames: `move` rewrites the vertices. Vertices on a UV seam are doubled, Mitsuba keeps one UV
per vertex. `prb` (path replay backpropagation, Vicini et al. 2021) is the integrator for gradients; plain differentiation of `path` takes
eight times its memory.
Limits: square pixels (|fx/fy − 1| < 0.1 %), no distortion, no skew.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.cameras import Cameras
from tasks.geometry.faults import Fault, refuse
from tasks.geometry.mitsuba_variant import load_mitsuba
from tasks.geometry.seams import cut_seams

Array = NDArray[np.float64]
Faces = NDArray[np.int32]

MAX_DEPTH = 4  # bounces; prb at 4 and 6 differ by less than the noise in the rendering experiments
FINAL_SAMPLES = 128  # per pixel, supplement A.4
TEXTURE, SHAPE = "actor.bsdf.brdf_0.reflectance.data", "actor.vertex_positions"


class PathTracer:
    """Keeps the Mitsuba scene of one mesh topology, texture and rig."""

    def __init__(
        self,
        cameras: Cameras,
        vertices: Array,
        faces: Faces,
        uv_vertices: Array,
        uv_faces: Faces,
        albedo: NDArray,
        *,
        max_depth: int = MAX_DEPTH,
    ) -> None:
        """Vertices [V, 3] m of any one frame; albedo [h, w, 3] linear. Raises BadInput for cameras that Mitsuba cannot express."""
        refuse(_lens_faults(cameras))
        self.mi = load_mitsuba()
        corners = cut_seams(faces, uv_faces)
        self._vertex = corners.vertex
        mesh = self._mesh(corners.faces, uv_vertices[corners.uv], vertices, albedo)
        self.scene = self.mi.load_dict(
            {
                "type": "scene",
                "integrator": {"type": "prb", "max_depth": max_depth, "hide_emitters": True},
                "light": {"type": "constant", "radiance": {"type": "rgb", "value": [1.0, 1.0, 1.0]}},
                "actor": mesh,
            }
        )
        self.params = self.mi.traverse(self.scene)
        self.sensors = [self._sensor(cameras, k) for k in range(len(cameras))]

    def move(self, vertices: Array) -> None:
        """Puts the mesh at vertices [V, 3] m."""
        self.params[SHAPE] = np.ascontiguousarray(vertices[self._vertex], np.float32).ravel()
        self.params.update()

    def paint(self, albedo: NDArray) -> None:
        """Gives the mesh another texture [h, w, 3], linear."""
        self.params[TEXTURE] = self.mi.TensorXf(np.ascontiguousarray(albedo, np.float32))
        self.params.update()

    def render(self, camera: int, *, samples: int = FINAL_SAMPLES, seed: int = 0) -> NDArray[np.float32]:
        """Linear image [height, width, 4] with coverage as fourth channel; colour is that of the covered part times coverage."""
        return np.array(self.mi.render(self.scene, sensor=self.sensors[camera], spp=samples, seed=seed))

    def _mesh(self, corners: Faces, uv: Array, vertices: Array, albedo: NDArray) -> Any:
        mi = self.mi
        bitmap = {"type": "bitmap", "data": mi.TensorXf(np.ascontiguousarray(albedo, np.float32)), "raw": True, "wrap_mode": "clamp"}
        properties = mi.Properties()
        properties["bsdf"] = mi.load_dict({"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": bitmap}})
        mesh = mi.Mesh("actor", len(self._vertex), len(corners), has_vertex_texcoords=True, props=properties)
        params = mi.traverse(mesh)
        params["faces"] = np.ascontiguousarray(corners, np.uint32).ravel()
        params["vertex_positions"] = np.ascontiguousarray(vertices[self._vertex], np.float32).ravel()
        params["vertex_texcoords"] = np.ascontiguousarray(np.column_stack([uv[:, 0], 1 - uv[:, 1]]), np.float32).ravel()
        params.update()
        return mesh

    def _sensor(self, cameras: Cameras, k: int) -> Any:
        width, height = (int(n) for n in cameras.size[k])
        K = cameras.K[k]
        pose = np.eye(4)  # Mitsuba's camera looks along +z with x to the left and y up
        pose[:3, :3] = cameras.R[k].T @ np.diag([-1.0, -1.0, 1.0])
        pose[:3, 3] = cameras.centres()[k]
        return self.mi.load_dict(
            {
                "type": "perspective",
                "fov_axis": "x",
                "fov": float(np.rad2deg(2 * np.arctan(width / (2 * K[0, 0])))),
                "principal_point_offset_x": float((width / 2 - K[0, 2]) / width),
                "principal_point_offset_y": float((height / 2 - K[1, 2]) / height),
                "near_clip": 1e-2,
                "far_clip": 1e3,
                "to_world": self.mi.ScalarTransform4f(pose),
                "film": {
                    "type": "hdrfilm",
                    "width": width,
                    "height": height,
                    "pixel_format": "rgba",
                    "rfilter": {"type": "box"},
                    "sample_border": False,
                },
                "sampler": {"type": "independent"},
            }
        )


def _lens_faults(cameras: Cameras) -> Sequence[Fault]:
    faults = []
    for name, K, distortion in zip(cameras.names, cameras.K, cameras.distortion, strict=True):
        if abs(K[0, 0] / K[1, 1] - 1) > 1e-3 or abs(K[0, 1]) > 1e-9 * K[0, 0]:
            faults.append(Fault(f"camera {name}", f"fx {K[0, 0]:.6g}, fy {K[1, 1]:.6g}, skew {K[0, 1]:.3g}", "Resample to square pixels."))
        if np.abs(distortion).max() > 0:
            faults.append(Fault(f"camera {name}", f"distortion {distortion.tolist()}", "Undistort images, masks and calibration first."))
    return faults
