"""Coarser meshes whose vertices are some of the given ones: half-edge collapse.

A vertex v is pulled onto a neighbour u, the shortest edge of the mesh first, so that what is known of the vertices left needs no
interpolation. It may go only where the surface stays what it was:

    v, u of one kind                      lines and zones keep their vertices to themselves
    v on a border                         goes along the border, and not where that turns
    common neighbours of v and u          are the corners across the edge, no more (link condition): the surface stays manifold
    faces that follow v                   turn by less than `TURN` and stay rounder than `ROUND`

Then edges are flipped where the surface is flat and triangles are not Delaunay. Source: Hoppe et al. 1993 (link condition); Kobbelt,
Campagna, Seidel 1998 (half-edge collapse); Lawson 1977 (flips). Limits: a mesh so full of lines that nothing may go stays larger than
asked.
"""

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.meshes import boundary_edges, edges

Array = NDArray[np.float64]
Indices = NDArray[np.int32]

TURN = np.cos(np.radians(40))  # of a face's normal, or of a border, in one collapse
ROUND = (0.5, 0.3, 0.15)  # least 4√3 area / Σ length² of a face, 1 for the regular one; the next where the last leaves too many vertices
FLIPS = 20  # most edges looked at, per face; on curved surfaces nobody has proved that flips end
FLAT = np.cos(np.radians(20))  # between the faces of an edge that may be flipped


@dataclass(frozen=True)
class Decimation:
    """kept [N] the vertices left, in their old order and numbers; faces [F', 3] of their new numbers; nearest [V] the new number of the
    kept vertex that is nearest to each old one along the edges of the old mesh.
    """

    kept: Indices
    faces: Indices
    nearest: Indices


def decimate(vertices: Array, faces: Indices, count: int, *, kind: Indices) -> Decimation:
    """At most `count` of the vertices [V, 3] m of faces [F, 3], more where nothing may go; a vertex goes only onto one of its own kind [V]."""
    mesh = _Collapsing(vertices, faces, kind)
    for least in ROUND:
        mesh.collapse(count, least)
    mesh.flip()
    kept = np.flatnonzero(mesh.alive).astype(np.int32)
    number = np.full(len(vertices), -1, np.int32)
    number[kept] = np.arange(len(kept))
    left = number[np.array([t for t in mesh.corners if t is not None], np.int32).reshape(-1, 3)]
    return Decimation(kept, left, number[_nearest(vertices, faces, kept)])


def roundness(vertices: Array, faces: Indices) -> Array:
    """4√3 area / Σ length² of each face [F]: 1 for the regular triangle, 0 for one without area."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    squares = sum(np.sum(d**2, 1) for d in (b - a, c - b, a - c))
    return 4 * np.sqrt(3) * area / squares


def _nearest(vertices: Array, faces: Indices, kept: Indices) -> Indices:
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra

    e, V = edges(faces), len(vertices)
    length = np.linalg.norm(vertices[e[:, 0]] - vertices[e[:, 1]], axis=1)
    graph = coo_matrix((length, (e[:, 0], e[:, 1])), shape=(V, V)).tocsr()
    return dijkstra(graph, directed=False, indices=kept, min_only=True, return_predecessors=True)[2].astype(np.int32)


class _Collapsing:
    """A mesh in the course of decimation: corners of each face (None: gone), faces around each vertex, vertices still there."""

    def __init__(self, vertices: Array, faces: Indices, kind: Indices) -> None:
        self.x, self.kind = vertices, kind.tolist()
        self.corners: list[tuple[int, int, int] | None] = [tuple(f) for f in faces.tolist()]
        self.around: list[set[int]] = [set() for _ in vertices]
        for f, corners in enumerate(faces.tolist()):
            for v in corners:
                self.around[v].add(f)
        self.alive = np.ones(len(vertices), bool)
        self.border = np.zeros(len(vertices), bool)
        self.border[boundary_edges(faces)] = True

    def collapse(self, count: int, least: float) -> None:
        """Pull vertices away, shortest edge first, until `count` are left or nothing may go; faces stay rounder than `least`."""
        queue = [move for v in np.flatnonzero(self.alive).tolist() for move in self._moves(v)]
        heapq.heapify(queue)
        waiting, left = set(queue), int(self.alive.sum())
        while queue and left > count:
            waiting.discard(move := heapq.heappop(queue))
            _, v, u = move
            if not (self.alive[v] and self.alive[u] and self._may(v, u, least)):
                continue
            self._pull(v, u)
            left -= 1
            # what was refused before may go now that the neighbourhood has changed
            for move in {m for w in (u, *self._neighbours(u)) for m in self._moves(w)} - waiting:
                waiting.add(move)
                heapq.heappush(queue, move)

    def flip(self) -> None:
        """Flip edges of flat parts until every pair of faces is Delaunay."""
        waiting = {e for t in self.corners if t is not None for e in _sides(t)}
        for _ in range(FLIPS * len(self.corners)):
            if not waiting:
                break
            a, b = waiting.pop()
            across = self._flippable(a, b)
            if across is not None:
                c, d, first, second = across
                self._replace(first, (c, d, b))
                self._replace(second, (d, c, a))
                waiting |= {_edge(*pair) for pair in ((a, c), (c, b), (b, d), (d, a))}

    def _moves(self, v: int) -> list[tuple[float, int, int]]:
        return [(float(np.sum((self.x[v] - self.x[u]) ** 2)), v, u) for u in sorted(self._neighbours(v)) if self.kind[u] == self.kind[v]]

    def _neighbours(self, v: int) -> set[int]:
        return {w for f in self.around[v] for w in self.corners[f]} - {v}

    def _may(self, v: int, u: int, least: float) -> bool:
        """Whether v may be pulled onto u."""
        shared = self.around[v] & self.around[u]
        across = {w for f in shared for w in self.corners[f]} - {v, u}
        own, other = self._neighbours(v), self._neighbours(u)
        if u not in own or own & other != across or (self.border[v] and len(shared) != 1):
            return False
        if self.border[v] and self._turn(v, u) < TURN:
            return False
        following = [self.corners[f] for f in self.around[v] - shared]
        pulled = [tuple(u if w == v else w for w in t) for t in following]
        if not pulled:
            return False
        before, after = self._normals(following), self._normals(pulled)
        turned = np.einsum("fi,fi->f", before, after) < TURN * np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
        return not turned.any() and bool((roundness(self.x, np.array(pulled)) >= least).all())

    def _turn(self, v: int, u: int) -> float:
        """Cosine of the turn of the border at v."""
        before = [w for w in self._neighbours(v) if w != u and len(self.around[v] & self.around[w]) == 1]
        into, out = self.x[v] - self.x[before], self.x[u] - self.x[v]
        return float((into @ out / (np.linalg.norm(into, axis=1) * np.linalg.norm(out))).min())

    def _normals(self, faces: list[tuple[int, int, int]]) -> Array:
        a, b, c = (self.x[[t[k] for t in faces]] for k in range(3))
        return np.cross(b - a, c - a)

    def _pull(self, v: int, u: int) -> None:
        for f in list(self.around[v]):
            corners = self.corners[f]
            if u in corners:
                for w in corners:
                    self.around[w].discard(f)
                self.corners[f] = None
            else:
                self._replace(f, tuple(u if w == v else w for w in corners))
        self.alive[v] = False

    def _replace(self, f: int, corners: tuple[int, int, int]) -> None:
        for w in self.corners[f]:
            self.around[w].discard(f)
        self.corners[f] = corners
        for w in corners:
            self.around[w].add(f)

    def _flippable(self, a: int, b: int) -> tuple[int, int, int, int] | None:
        """The corners c (left of a → b) and d across the edge and its two faces, where flipping it makes better triangles and bends nothing."""
        shared = sorted(self.around[a] & self.around[b])
        if len(shared) != 2 or self.kind[a] == self.kind[b] != 0:
            return None
        first, second = shared if _runs(self.corners[shared[0]], a, b) else shared[::-1]
        c, d = (next(w for w in self.corners[f] if w not in (a, b)) for f in (first, second))
        if self.around[c] & self.around[d] or not self._angles(a, b, c, d) > np.pi + 1e-6:
            return None
        faces = [self.corners[first], self.corners[second], (c, d, b), (d, c, a)]
        n = self._normals(faces)
        size = np.linalg.norm(n, axis=1)
        along = n @ n[0]
        return (c, d, first, second) if size.min() > 0 and (along >= FLAT * size * size[0]).all() else None

    def _angles(self, a: int, b: int, c: int, d: int) -> float:
        """Sum of the angles at c and d that look at the edge a, b."""
        total = 0.0
        for tip in (c, d):
            p, q = self.x[a] - self.x[tip], self.x[b] - self.x[tip]
            total += float(np.arctan2(np.linalg.norm(np.cross(p, q)), p @ q))
        return total


def _edge(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)


def _sides(t: tuple[int, int, int]) -> tuple[tuple[int, int], ...]:
    return tuple(_edge(t[k], t[(k + 1) % 3]) for k in range(3))


def _runs(t: tuple[int, int, int], a: int, b: int) -> bool:
    """Whether a → b runs along the face."""
    return (a, b) in ((t[0], t[1]), (t[1], t[2]), (t[2], t[0]))
