"""First hits of rays on a moving triangle mesh, by Mitsuba's ray tracer.

One scene is built for a mesh and its vertices are rewritten for every frame: rebuilding the hierarchy costs 0.03 s, a new scene ten
times that. Measured on one core with 10,240 faces: 0.55 s per million incoherent rays; Embree through embreex is twice as fast but would be
a dependency for this alone. Single precision: a hit nearer than about 1e-4 m of the origin is not reliable.
"""

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.mitsuba_variant import load_mitsuba

FRONT, BACK = 0, 1  # side of a face: the one its counter-clockwise normal points to, and the other


class RayTracer:
    """Keeps the scene of one mesh topology; `move` sets the frame, `first_hits` casts."""

    def __init__(self, faces: NDArray[np.int32], vertex_count: int) -> None:
        self._mi = load_mitsuba()
        mesh = self._mi.Mesh("cast", vertex_count, len(faces))
        params = self._mi.traverse(mesh)
        params["faces"] = np.ascontiguousarray(faces, np.uint32).ravel()
        params["vertex_positions"] = np.random.default_rng(0).random(3 * vertex_count).astype(np.float32)
        params.update()
        self._scene = self._mi.load_dict({"type": "scene", "cast": mesh})
        self._params = self._mi.traverse(self._scene)
        self._faces = faces

    def move(self, vertices: NDArray) -> None:
        """Puts the mesh at vertices [V, 3] m."""
        self._params["cast.vertex_positions"] = np.ascontiguousarray(vertices, np.float32).ravel()
        self._params.update()
        a, b, c = (vertices[self._faces[:, k]] for k in range(3))
        self._normals = np.cross(b - a, c - a)

    def first_hits(self, origins: NDArray, directions: NDArray) -> NDArray[np.int32]:
        """2·face + side of the first surface met by rays [N, 3]; −1 where nothing is met. The side is the one that faces the ray."""
        mi = self._mi
        ray = mi.Ray3f(mi.Point3f(np.ascontiguousarray(origins.T, np.float32)), mi.Vector3f(np.ascontiguousarray(directions.T, np.float32)))
        met = self._scene.ray_intersect_preliminary(ray, coherent=False)
        hit = np.array(met.is_valid())
        face = np.array(met.prim_index).astype(np.int32)[hit]
        away = np.einsum("nc,nc->n", self._normals[face], directions[hit]) > 0
        code = np.full(len(origins), -1, np.int32)
        code[hit] = 2 * face + np.where(away, BACK, FRONT)
        return code
