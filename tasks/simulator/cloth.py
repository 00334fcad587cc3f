"""What is simulated (cloth) and what it meets (collider)."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.faults import Fault, refuse
from tasks.geometry.meshes import edges, face_areas, hinges, loose_vertex_faults, mesh_faults

Array = NDArray[np.float64]
Indices = NDArray[np.int32]


@dataclass(frozen=True)
class Cloth:
    """A triangle mesh of cloth in its rest shape.

    x_rest [V, 3] m, faces [F, 3], boundary [B] vertices whose motion is prescribed, uv [F, 3, 2] m flat rest coordinates of the corners of
    each face (u weft, v warp; None: the faces of x_rest laid flat), rest_angles: hinges at rest as in x_rest ("worn") or unfolded ("flat").
    Raises BadInput for a mesh that cannot be simulated.
    """

    x_rest: Array
    faces: Indices
    boundary: Indices = field(default_factory=lambda: np.empty(0, np.int32))
    uv: Array | None = None
    rest_angles: Literal["worn", "flat"] = "worn"

    def __post_init__(self) -> None:
        object.__setattr__(self, "x_rest", np.ascontiguousarray(self.x_rest, float))
        object.__setattr__(self, "faces", np.ascontiguousarray(self.faces, np.int32))
        object.__setattr__(self, "boundary", np.asarray(self.boundary, np.int32).ravel())
        if self.uv is not None:
            object.__setattr__(self, "uv", np.ascontiguousarray(self.uv, float))
        refuse(self._faults())

    def _faults(self) -> list[Fault]:
        faults = mesh_faults(self.x_rest, self.faces, "cloth.x_rest", metres=False)
        faults += loose_vertex_faults(self.faces, len(self.x_rest), "cloth.x_rest")
        V, B = len(self.x_rest), self.boundary
        if len(B) and (B.min() < 0 or B.max() >= V or len(np.unique(B)) < len(B)):
            faults.append(
                Fault("cloth.boundary", f"{len(B)} entries between {B.min()} and {B.max()} for {V} vertices", "Name each vertex once.")
            )
        if self.uv is not None and self.uv.shape != (len(self.faces), 3, 2):
            faults.append(Fault("cloth.uv", f"shape {self.uv.shape}", f"Give metres per corner of each face, [{len(self.faces)}, 3, 2]."))
        elif self.uv is not None and not faults:
            faults += self._pattern_faults(self.uv)
        return faults

    def _pattern_faults(self, uv: Array) -> list[Fault]:
        """Faces without area in the pattern, and faces folded over their neighbour."""
        area = _signed_areas(uv)
        if not np.isfinite(uv).all():
            return [Fault("cloth.uv", "values that are not finite", "Repair them.")]
        faults, flat = [], np.flatnonzero(np.abs(area) <= 1e-12 * np.ptp(uv, axis=(0, 1)).max() ** 2)
        if len(flat):
            faults.append(Fault("cloth.uv", f"{len(flat)} faces have no area in the pattern, the first is face {flat[0]}", "Repair it."))
        folded = _folds(self.faces, uv, area)
        if len(folded):
            faults.append(
                Fault("cloth.uv", f"{len(folded)} faces are turned over next to a neighbour, the first is face {folded[0]}", "Unfold it.")
            )
        return faults

    @property
    def rest_areas(self) -> Array:
        """Areas of the faces at rest [F] m²; of the pattern where there is one."""
        if self.uv is None:
            return face_areas(self.x_rest, self.faces)
        return np.abs(_signed_areas(self.uv))

    @property
    def vertex_areas(self) -> Array:
        """A third of the rest area of the faces around each vertex [V] m²."""
        return np.bincount(self.faces.ravel(), np.repeat(self.rest_areas / 3, 3), len(self.x_rest))

    @cached_property
    def held_edges(self) -> Indices:
        """Edges between prescribed vertices [J, 2], as places in `boundary`."""
        place = np.full(len(self.x_rest), -1, np.int32)
        place[self.boundary] = np.arange(len(self.boundary))
        ends = place[edges(self.faces)]
        return ends[(ends >= 0).all(1)]

    @property
    def hinges(self) -> Indices:
        """Interior edges with their opposite corners [H, 4]."""
        return hinges(self.faces)


def _signed_areas(uv: Array) -> Array:
    """Areas [F] m² of the pattern's faces, negative where it is seen from behind."""
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    return (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2


def _folds(faces: Indices, uv: Array, area: Array) -> Indices:
    """Faces whose pattern turns the other way than a neighbour's across an edge that both lay in the same place."""
    corner = np.array([[0, 1], [1, 2], [2, 0]])
    edge, place = faces[:, corner].reshape(-1, 2), uv[:, corner].reshape(-1, 2, 2)
    turned = edge[:, 0] > edge[:, 1]
    edge[turned], place[turned] = edge[turned, ::-1], place[turned, ::-1]
    order = np.lexsort(edge.T)
    one, two = order[:-1], order[1:]
    shared = (edge[one] == edge[two]).all(1) & np.isclose(place[one], place[two], atol=1e-9).all((1, 2))
    clash = shared & (area[one // 3] * area[two // 3] < 0)
    return np.unique(np.maximum(one[clash] // 3, two[clash] // 3))


@dataclass(frozen=True)
class Collider:
    """A surface that moves as told and that cloth cannot cross: faces [C_F, 3] into the vertices of the motion [T, C, 3]."""

    faces: Indices

    def __post_init__(self) -> None:
        object.__setattr__(self, "faces", np.ascontiguousarray(self.faces, np.int32).reshape(-1, 3))


NO_COLLIDER = Collider(np.empty((0, 3), np.int32))
