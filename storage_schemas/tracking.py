"""Tracking: the dressed surface, one welded mesh that keeps its vertices over the whole sequence.

* `vertices` is where tracking puts each vertex; `seen` whether two cameras saw it there, `noise_m` the standard deviation of a coordinate
  of its position where it is seen. A vertex that is not seen MAY be NaN and MUST NOT be compared with anything; its `noise_m` says nothing.
* `faces` index `vertices`; a texture seam has no double vertices, so `uv_faces` index `uv_vertices` separately.
* `part_of_face` indexes `part_names`: "body" and the names of the garments.
* `photometric_rms` compares render and image over the person, in units of full white.
* `endings` tells per frame, or per stretch of frames, in one sentence how the optimisation ended.
"""

from __future__ import annotations

import numpy as np

from storage_schemas.faults import Fault
from storage_schemas.fields import array, names
from storage_schemas.record import Record


class Tracking(Record, name="tracking", version=1):
    """The observed motion of the dressed surface."""

    vertices: np.ndarray = array("frame vertex 3", "float32", "m")
    faces: np.ndarray = array("face 3", "int32", "vertex index")
    uv_vertices: np.ndarray = array("uv_vertex 2", "float32", "1")
    uv_faces: np.ndarray = array("face 3", "int32", "uv_vertex index")
    part_names: tuple[str, ...] = names("part")
    part_of_face: np.ndarray = array("face", "int32", "part index")
    seen: np.ndarray = array("frame vertex", "bool", "1")
    noise_m: np.ndarray = array("frame vertex", "float32", "m")
    photometric_rms: np.ndarray = array("frame", "float32", "1")
    endings: tuple[str, ...] = ()

    def faults(self) -> list[Fault]:
        """A vertex that is seen has a place."""
        if (np.isfinite(self.vertices).all(axis=-1) | ~self.seen).all():
            return []
        return [self.fault("vertices", "is not finite where `seen` is true", "set `seen` to false there")]
