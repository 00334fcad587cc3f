"""Which edges and edges, faces and vertices come near one another on a segment: the broad phase of contact, by trees of boxes.

The elements of a surface are sorted once, at rest, into a binary tree: halves along the longest side of the box around their centres.
Whatever the surface does later, a node's box is the one around its two children's, and is only made anew; two trees are gone through
together, from the roots down, as far as boxes meet. Neighbours on a surface stay neighbours, so that boxes stay small without ever sorting
again, which is what a tree of the moment spends its time on.

Source: van den Bergen 1997, Efficient collision detection of complex deformable models using AABB trees. Limits: boxes of elements that
drift apart, as of two fingers that were one half, meet needlessly; nothing is missed.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int32]
Flags = NDArray[np.bool_]
LEAF = 8  # most elements of a leaf


@dataclass(frozen=True)
class BoxTree:
    """Elements [P, m] of a surface in the order of a tree: node n has children 2n + 1 and 2n + 2, and holds elements start[n]:end[n].

    number [P]: of each element in the order it was given; free [P]: whether something may move it; free_below [nodes]: whether it may move
    any below.
    """

    elements: Indices
    number: Indices
    start: Indices
    end: Indices
    free: Flags
    free_below: Flags

    @classmethod
    def of(cls, elements: Indices, x_rest: Array, prescribed: Flags) -> Self:
        """The tree of elements [P, m] on vertices x_rest [V, 3] m, of which some are prescribed [V]."""
        levels = max(0, int(np.ceil(np.log2(max(len(elements), 1) / LEAF))))
        start, end = np.zeros(2 ** (levels + 1) - 1, np.int32), np.zeros(2 ** (levels + 1) - 1, np.int32)
        number = np.arange(len(elements), dtype=np.int32)
        end[0] = len(elements)
        centres = x_rest[elements].mean(1)
        for level in range(levels):
            n = np.arange(2**level - 1, 2 ** (level + 1) - 1)
            number = _sorted_along_longest_side(number, start[n], end[n], centres)
            middle = start[n] + (end[n] - start[n]) // 2
            start[2 * n + 1], end[2 * n + 1] = start[n], middle
            start[2 * n + 2], end[2 * n + 2] = middle, end[n]
        free = ~prescribed[elements[number]].all(1)
        count = np.concatenate([[0], np.cumsum(free)])
        below = count[end] > count[start]
        return cls(np.ascontiguousarray(elements[number], np.int32), number, start, end, free, below)

    def boxes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Boxes (low, high) of all elements [P, 6] and all nodes [N, 6], given those of the vertices, low and high [V, 3] m."""
        return _boxes(self.elements, self.start, self.end, low, high)


def near_pairs(edges: BoxTree, faces: BoxTree, vertices: BoxTree, low: Array, high: Array) -> tuple[Indices, Indices]:
    """Pairs of edges [N, 2] and of a face and a vertex [M, 2] whose boxes meet, given the boxes of all vertices, low and high [V, 3] m.

    Left out: pairs that share a vertex, and pairs all of whose vertices are prescribed.
    """
    boxes_e, boxes_f, boxes_v = edges.boxes(low, high), faces.boxes(low, high), vertices.boxes(low, high)
    return _meeting(edges, boxes_e, edges, boxes_e, same=True), _meeting(faces, boxes_f, vertices, boxes_v, same=False)


def _meeting(A: BoxTree, boxes_a: tuple[Array, Array], B: BoxTree, boxes_b: tuple[Array, Array], *, same: bool) -> Indices:
    place = _walk(
        A.elements, A.start, A.end, A.free, A.free_below, *boxes_a, B.elements, B.start, B.end, B.free, B.free_below, *boxes_b, same
    )
    return np.stack([A.number[place[:, 0]], B.number[place[:, 1]]], 1)


def _sorted_along_longest_side(number: Indices, start: Indices, end: Indices, centres: Array) -> Indices:
    """The elements of each node start:end, all there are, in the order of their centres [P, 3] along the longest side of its box."""
    c, node = centres[number], np.repeat(np.arange(len(start)), end - start)
    longest = (np.maximum.reduceat(c, start) - np.minimum.reduceat(c, start)).argmax(1)
    return number[np.lexsort((c[np.arange(len(c)), longest[node]], node))]


@njit(cache=True, nogil=True, error_model="numpy")
def _boxes(elements, start, end, low, high):
    P, m = elements.shape
    own, nodes = np.empty((P, 6)), np.empty((len(start), 6))
    for e in range(P):
        for k in range(3):
            a, b = low[elements[e, 0], k], high[elements[e, 0], k]
            for i in range(1, m):
                a, b = min(a, low[elements[e, i], k]), max(b, high[elements[e, i], k])
            own[e, k], own[e, 3 + k] = a, b
    first_leaf = len(start) // 2
    for n in range(len(start) - 1, -1, -1):
        for k in range(3):
            a, b = np.inf, -np.inf
            if n >= first_leaf:
                for e in range(start[n], end[n]):
                    a, b = min(a, own[e, k]), max(b, own[e, 3 + k])
            else:
                a, b = min(nodes[2 * n + 1, k], nodes[2 * n + 2, k]), max(nodes[2 * n + 1, 3 + k], nodes[2 * n + 2, 3 + k])
            nodes[n, k], nodes[n, 3 + k] = a, b
    return own, nodes


@njit(cache=True, nogil=True, error_model="numpy")
def _walk(A, start_a, end_a, free_a, below_a, own_a, nodes_a, B, start_b, end_b, free_b, below_b, own_b, nodes_b, same):
    """Places [N, 2] in A and B of elements whose boxes meet; same: A is B, and each pair is told once."""
    found, n = np.empty((4096, 2), np.int32), 0
    leaf_a, leaf_b = len(start_a) // 2, len(start_b) // 2
    stack, top = np.empty((256, 2), np.int32), 1
    stack[0] = 0
    while top:
        top -= 1
        p, q = stack[top]
        if not ((below_a[p] or below_b[q]) and _meet(nodes_a, p, nodes_b, q)):
            continue
        if p < leaf_a or q < leaf_b:
            own = same and p == q
            for r in range(2 * p + 1, 2 * p + 3) if p < leaf_a else range(p, p + 1):
                for s in range(2 * q + 1, 2 * q + 3) if q < leaf_b else range(q, q + 1):
                    if not own or r <= s:
                        stack[top, 0], stack[top, 1] = r, s
                        top += 1
            continue
        if n + (end_a[p] - start_a[p]) * (end_b[q] - start_b[q]) > len(found):
            grown = np.empty((2 * len(found), 2), np.int32)
            grown[:n] = found[:n]
            found = grown
        for a in range(start_a[p], end_a[p]):
            if not _meet(own_a, a, nodes_b, q):
                continue
            for b in range(max(start_b[q], a + 1) if same else start_b[q], end_b[q]):
                if _meet(own_a, a, own_b, b) and (free_a[a] or free_b[b]) and not _share(A, a, B, b):
                    found[n, 0], found[n, 1] = a, b
                    n += 1
    return found[:n]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _meet(A, a, B, b):
    return (
        A[a, 0] <= B[b, 3]
        and B[b, 0] <= A[a, 3]
        and A[a, 1] <= B[b, 4]
        and B[b, 1] <= A[a, 4]
        and A[a, 2] <= B[b, 5]
        and B[b, 2] <= A[a, 5]
    )


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _share(A, a, B, b):
    for i in range(A.shape[1]):
        for j in range(B.shape[1]):
            if A[a, i] == B[b, j]:
                return True
    return False
