"""The tracked surface: topology, surface samples, and what its shape should be at one instant.

Each face carries k² samples, the centroids of its k² equal parts (k = 2: barycentric (2/3, 1/6, 1/6), its permutations, and the centroid).
Sample s of face f is number f·k² + s. Layers say what is worn over what: skin 0, garments 1.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.meshes import edge_lengths, face_areas
from tasks.geometry.meshes import edges as mesh_edges
from tasks.geometry.meshes import hinges as mesh_hinges
from tasks.geometry.parts import SKIN
from tasks.tracking import blocks, isometry, normal_consistency
from tasks.tracking.settings import Settings

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Surface:
    """faces [F, 3]; edges [E, 2] with weight [E]; hinges [H, 4]; barycentric [n, 3] of a face's samples; layer [F];
    mean_edge m, mean_face m².
    """

    faces: NDArray[np.int32]
    edges: NDArray[np.int32]
    edge_weight: Array
    hinges: NDArray[np.int32]
    barycentric: Array
    layer: NDArray[np.int8]
    mean_edge: float
    mean_face: float
    pattern: blocks.Pattern

    @property
    def samples(self) -> int:
        """How many samples there are."""
        return len(self.faces) * len(self.barycentric)


@dataclass(frozen=True)
class Shape:
    """What the surface should be like now: rest lengths [E] m, normal differences [H, 3], anchors [V, 3] m and their weights [V] 1/m²."""

    rest: Array
    bend: Array
    anchor: Array
    anchor_weight: Array


def surface(template: Array, faces: NDArray[np.integer], part: NDArray[np.str_], settings: Settings) -> Surface:
    """Everything that stays the same over the sequence, from the template [V, 3] m and the part of each face [F]."""
    faces = np.ascontiguousarray(faces, dtype=np.int32)
    edges, hinges = mesh_edges(faces), mesh_hinges(faces)
    return Surface(
        faces=faces,
        edges=edges,
        edge_weight=isometry.weights(template, faces, edges, sigma=settings.sigma_strain),
        hinges=hinges,
        barycentric=centroids_of_parts(settings.subdivision),
        layer=(np.asarray(part) != SKIN).astype(np.int8),
        mean_edge=float(edge_lengths(template, edges).mean()),
        mean_face=float(face_areas(template, faces).mean()),
        pattern=blocks.pattern(len(template), faces, edges, hinges),
    )


def centroids_of_parts(k: int) -> Array:
    """Barycentric coordinates [k², 3] of the centroids of the k² equal triangles that lines parallel to the sides cut."""
    up = [(3 * i + 1, 3 * j + 1) for i in range(k) for j in range(k - i)]
    down = [(3 * i + 2, 3 * j + 2) for i in range(k - 1) for j in range(k - 1 - i)]
    ij = np.array(up + down, float) / (3 * k)
    return np.column_stack([1 - ij.sum(1), ij])


def shape(surface: Surface, template: Array, prediction: Array | None, start: Array, settings: Settings) -> Shape:
    """Template lengths, flat hinges and weak anchors at `start` [V, 3] m, where inertia would take the vertices.

    Where all corners have a predicted place [V, 3] m (else NaN): the predicted lengths, normals and anchors instead.
    """
    rest = edge_lengths(template, surface.edges)
    bend = np.zeros((len(surface.hinges), 3))
    if prediction is None:
        return Shape(rest, bend, start, np.full(len(start), settings.sigma_inertia**-2))
    known = np.isfinite(prediction).all(1)
    anchor = np.where(known[:, None], prediction, start)
    edge, hinge = known[surface.edges].all(1), known[surface.hinges].all(1)
    rest[edge] = edge_lengths(anchor, surface.edges[edge])
    bend[hinge] = normal_consistency.normal_difference(anchor, surface.hinges[hinge])
    return Shape(rest, bend, anchor, np.where(known, settings.sigma_prediction, settings.sigma_inertia) ** -2.0)
