"""One garment, cut out of the tracked surface: its mesh, what it is compared with, and the body it lies on."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.meshes import submesh
from tasks.simulator import Cloth, Fabric
from tasks.simulator.fabric import THICKNESS

Array = NDArray[np.float64]
Indices = NDArray[np.int32]


@dataclass(frozen=True)
class Garment:
    """name; index [V] into the tracked surface; faces [F, 3] of its own vertices; observed [T, V, 3] m; seen [T, V]; noise_m [T, V]; uv_faces [F, 3]."""

    name: str
    index: Indices
    faces: Indices
    observed: Array
    seen: NDArray[np.bool_]
    noise_m: Array
    uv_faces: Indices


def garments(
    vertices: Array, faces: Indices, uv_faces: Indices, part: NDArray[np.str_], seen: NDArray[np.bool_], noise_m: Array
) -> list[Garment]:
    """Every part of the tracked surface (vertices [T, V, 3] m, part [F]) that is not the body."""
    found = []
    for name in sorted(set(part.tolist()) - {"body"}):
        own = part == name
        keep = np.zeros(vertices.shape[1], bool)
        keep[faces[own]] = True
        number = np.cumsum(keep) - 1
        index = submesh(faces[own], keep)[1]
        own_faces = number[faces[own]].astype(np.int32)
        found.append(Garment(name, index, own_faces, vertices[:, index], seen[:, index], noise_m[:, index], uv_faces[own]))
    return found


def weighed(fabric: Fabric, cloths: Sequence[Cloth], mass_kg: float | None) -> Fabric:
    """The fabric in the density ρ = m/(A t) of garments that were weighed together, A their rest area; as it is where nobody weighed them."""
    if mass_kg is None:
        return fabric
    area = sum(float(cloth.rest_areas.sum()) for cloth in cloths)
    return replace(fabric, density=mass_kg / area / THICKNESS)
