"""Finer meshes: bisection of the longest edge of every triangle.

As every triangle marks its own longest edge, a marked edge of a triangle always comes with its longest: halving that one first and then the
halves gives two to four triangles, and neighbours fit. Each new vertex is the midpoint of an edge; about as many come as there are
vertices. Source: Rivara 1984. Angles stay above half of the smallest one of the mesh.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int32]

# children of a face (a, b, c) whose longest edge is a→b, as corners of (a, b, c, midpoint ab, midpoint bc, midpoint ca)
_LEFT = {False: [[0, 3, 2]], True: [[0, 3, 5], [5, 3, 2]]}
_RIGHT = {False: [[3, 1, 2]], True: [[3, 1, 4], [3, 4, 2]]}
_WEIGHTS = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5]])


@dataclass(frozen=True)
class Refinement:
    """faces [F', 3]; parents [N, 2] of the new vertices, which come after the V old ones; parent_face [F'], and barycentric [F', corner, 3]."""

    faces: Indices
    parents: Indices
    parent_face: Indices
    barycentric: Array

    def field(self, x: Array) -> Array:
        """A field [..., V, 3] on all vertices [..., V + N, 3]."""
        return np.concatenate([x, x[..., self.parents, :].mean(-2)], -2)

    def corners(self, values: Array) -> Array:
        """Values [F, 3, K] of the corners of the old faces, at those of the new ones [F', 3, K]."""
        return self.barycentric @ values[self.parent_face]


def refine(vertices: Array, faces: Indices) -> Refinement:
    """Split the longest edge of every face [F, 3] of vertices [V, 3] m; of edges equally long the one with the smaller vertices."""
    turned, shift = _longest_first(vertices, faces)
    marked = np.unique(np.sort(turned[:, :2], 1), axis=0)
    number = {(int(a), int(b)): len(vertices) + i for i, (a, b) in enumerate(marked)}
    out, parent, weights = [], [], []
    for f, (a, b, c) in enumerate(turned.tolist()):
        six = [a, b, c, *(number.get((min(e), max(e)), -1) for e in ((a, b), (b, c), (c, a)))]
        children = _LEFT[six[5] >= 0] + _RIGHT[six[4] >= 0]
        out += [[six[k] for k in child] for child in children]
        parent += [f] * len(children)
        weights += children
    parent = np.array(parent, np.int32)
    barycentric = np.take_along_axis(_WEIGHTS[np.array(weights)], _old_order(shift[parent])[:, None, :], 2)
    return Refinement(np.array(out, np.int32), marked.astype(np.int32), parent, barycentric)


def _longest_first(vertices: Array, faces: Indices) -> tuple[Indices, Indices]:
    """Each face turned so that its longest edge is the first, and by how many corners [F]."""
    ends = np.stack([faces, np.roll(faces, -1, 1)], 2)
    length = np.linalg.norm(vertices[ends[..., 0]] - vertices[ends[..., 1]], axis=2)
    length = np.round(length / length.max(), 9)  # what is equally long but for rounding counts as such
    low, high = ends.min(2), ends.max(2)
    shift = np.lexsort(np.stack([high, low, -length]), axis=1)[:, 0]
    return np.take_along_axis(faces, (shift[:, None] + np.arange(3)) % 3, 1), shift


def _old_order(shift: Indices) -> Indices:
    """Where each corner of the face as given stands in the turned one [F', 3]."""
    return (np.arange(3) - shift[:, None]) % 3
