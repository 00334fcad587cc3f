"""Sparse normal equations in 3 × 3 blocks on a fixed pattern, and their solution by conjugate gradients.

The energy is a sum over small families of elements (faces, edges, hinges) whose corners are mesh vertices. Every element hands in a
gradient [k, 3] and a Hessian [k, k, 3, 3]; each row of the matrix then gathers from the elements around its vertex. A row belongs to
one thread and adds in a fixed order, and the solver runs on one thread, so results do not depend on the number of threads, to the last bit.

Source: block compressed rows as in Saad (2003), Iterative Methods for Sparse Linear Systems, §3.4; preconditioned CG, algorithm 9.1.
Limits: symmetric positive definite systems; the pattern holds what shares an element, no fill.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Family:
    """Elements of one kind. corners [N, k] vertices; slot [N, k, k] places in the matrix; around vertex v:
    incident[start[v]:start[v+1]] = (element, corner).
    """

    corners: Index
    slot: Index
    start: Index
    incident: Index


@dataclass(frozen=True)
class Pattern:
    """Rows row_start [V + 1], columns [nnz] ascending in each row, diagonal [V] places, and the families that write into it."""

    row_start: Index
    column: Index
    diagonal: Index
    families: tuple[Family, ...]


@dataclass(frozen=True)
class NormalEquations:
    """(blocks) δ = −gradient. blocks [nnz, 3, 3], gradient [V, 3]."""

    pattern: Pattern
    blocks: Array
    gradient: Array


def pattern(vertex_count: int, *corner_lists: NDArray[np.integer]) -> Pattern:
    """The pattern of all pairs of vertices [N, k] that share an element of any family; every vertex has its diagonal."""
    n = vertex_count
    lists = [np.ascontiguousarray(c, dtype=np.int64) for c in corner_lists]
    pairs = [(c[:, :, None] * n + c[:, None, :]).ravel() for c in lists]
    keys = np.unique(np.concatenate([*pairs, np.arange(n, dtype=np.int64) * (n + 1)]))
    row_start = np.searchsorted(keys, np.arange(n + 1, dtype=np.int64) * n)
    families = tuple(_family(n, c, keys) for c in lists)
    return Pattern(row_start, keys % n, np.searchsorted(keys, np.arange(n, dtype=np.int64) * (n + 1)), families)


def assemble(pattern: Pattern, terms: list[tuple[Array, Array]], *, diagonal: Array) -> NormalEquations:
    """Sum of the families' (gradient [N, k, 3], Hessian [N, k, k, 3, 3]), in the pattern's order, and a multiple of the identity [V] on
    each diagonal block.
    """
    blocks = np.zeros((len(pattern.column), 3, 3))
    gradient = np.zeros((len(pattern.diagonal), 3))
    blocks[pattern.diagonal] += diagonal[:, None, None] * np.eye(3)
    for family, (g, H) in zip(pattern.families, terms, strict=True):
        _gather(family.slot, family.start, family.incident, g, H, gradient, blocks)
    return NormalEquations(pattern, blocks, gradient)


def solve(system: NormalEquations, *, damping: float = 0.0, tolerance: float = 1e-3, cap: int = 150) -> tuple[Array, int]:
    """δ [V, 3] with (blocks + damping·I) δ = −gradient, and the iterations used.

    Block-Jacobi preconditioned conjugate gradients; stops when the preconditioned residual √(rᵀM⁻¹r) has fallen by `tolerance`.
    """
    blocks = system.blocks.copy()
    blocks[system.pattern.diagonal] += damping * np.eye(3)
    inverse = np.linalg.inv(blocks[system.pattern.diagonal])
    return _conjugate_gradients(system.pattern.row_start, system.pattern.column, blocks, inverse, -system.gradient, tolerance, cap)


def dense(system: NormalEquations) -> Array:
    """The matrix [3V, 3V] in full, for small meshes."""
    n = len(system.gradient)
    A = np.zeros((n, n, 3, 3))
    row = np.repeat(np.arange(n), np.diff(system.pattern.row_start))
    A[row, system.pattern.column] = system.blocks
    return A.transpose(0, 2, 1, 3).reshape(3 * n, 3 * n)


def _family(n: int, corners: Index, keys: Index) -> Family:
    slot = np.searchsorted(keys, corners[:, :, None] * n + corners[:, None, :])
    order = np.argsort(corners.ravel(), kind="stable")
    start = np.searchsorted(corners.ravel()[order], np.arange(n + 1))
    k = corners.shape[1]
    return Family(corners, slot, start, np.column_stack([order // k, order % k]))


@njit(parallel=True, cache=True)
def _gather(slot, start, incident, g, H, gradient, blocks):
    k = slot.shape[1]
    for v in prange(len(start) - 1):
        for q in range(start[v], start[v + 1]):
            e, i = incident[q]
            for a in range(3):
                gradient[v, a] += g[e, i, a]
            for j in range(k):
                s = slot[e, i, j]
                for a in range(3):
                    for b in range(3):
                        blocks[s, a, b] += H[e, i, j, a, b]


@njit(cache=True)
def _conjugate_gradients(row_start, column, blocks, inverse, b, tolerance, cap):
    x, r, p, q, z = np.zeros_like(b), b.copy(), np.zeros_like(b), np.empty_like(b), np.empty_like(b)
    rz, target = 1.0, -1.0
    for k in range(cap + 1):
        before, rz = rz, _precondition(inverse, r, z)
        if target < 0:
            target = rz * tolerance * tolerance
        if rz <= target or k == cap:
            return x, k
        _add(p, z, rz / before if k else 0.0)
        α = rz / _multiply(row_start, column, blocks, p, q)
        for v in range(len(x)):
            for a in range(3):
                x[v, a] += α * p[v, a]
                r[v, a] -= α * q[v, a]
    return x, cap


@njit(cache=True)
def _precondition(inverse, r, z):
    """z = M⁻¹ r, and rᵀz."""
    s = 0.0
    for v in range(len(r)):
        for a in range(3):
            z[v, a] = inverse[v, a, 0] * r[v, 0] + inverse[v, a, 1] * r[v, 1] + inverse[v, a, 2] * r[v, 2]
            s += z[v, a] * r[v, a]
    return s


@njit(cache=True)
def _add(p, z, β):
    """p ← z + β p."""
    for v in range(len(p)):
        for a in range(3):
            p[v, a] = z[v, a] + β * p[v, a]


@njit(cache=True)
def _multiply(row_start, column, blocks, p, q):
    """q = A p, and pᵀq."""
    s = 0.0
    for v in range(len(p)):
        q0, q1, q2 = 0.0, 0.0, 0.0
        for k in range(row_start[v], row_start[v + 1]):
            w = column[k]
            p0, p1, p2 = p[w, 0], p[w, 1], p[w, 2]
            q0 += blocks[k, 0, 0] * p0 + blocks[k, 0, 1] * p1 + blocks[k, 0, 2] * p2
            q1 += blocks[k, 1, 0] * p0 + blocks[k, 1, 1] * p1 + blocks[k, 1, 2] * p2
            q2 += blocks[k, 2, 0] * p0 + blocks[k, 2, 1] * p1 + blocks[k, 2, 2] * p2
        q[v, 0], q[v, 1], q[v, 2] = q0, q1, q2
        s += p[v, 0] * q0 + p[v, 1] * q1 + p[v, 2] * q2
    return s
