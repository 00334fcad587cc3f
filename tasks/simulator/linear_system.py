"""The sparse symmetric system of the free nodes: assembly into a kept pattern, Cholesky with a kept symbolic analysis.

Prescribed nodes and the collider have no rows. The lower triangle is stored in blocks of 3×3; the place of every element's blocks is found
once. Contact among cloth may ask for blocks that the pattern lacks: it then grows, and is analysed anew.

Source: Chen, Davis, Hager, Rajamanickam 2008 (CHOLMOD). Without scikit-sparse, scipy's LU in symmetric mode serves, several times slower.
"""

from collections.abc import Sequence
from copy import copy
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from tasks.geometry.cholmod_kernels import load_cholmod, one_thread
from tasks.simulator.potential import Blocks

Array = NDArray[np.float64]
Indices = NDArray[np.int32]

AT_ONCE = 64  # right-hand sides that are solved for at once: what CHOLMOD holds of more leaves the cache


class NotPositiveDefinite(ArithmeticError):
    """The matrix has no Cholesky factor."""


class Factor(Protocol):
    """A factorised matrix."""

    def solve(self, b: Array) -> Array:
        """A⁻¹ b for b [n] or [n, P]."""
        ...


class LinearSystem:
    """Assembles and factorises on the free nodes of V, given the stencils that are always there."""

    def __init__(self, vertex_count: int, prescribed: Indices, stencils: Sequence[Indices]) -> None:
        self.node = np.full(vertex_count, -1, np.int32)
        self.free = np.setdiff1d(np.arange(vertex_count, dtype=np.int32), prescribed)
        self.node[self.free] = np.arange(len(self.free))
        self._used: set[int] = set()
        self._constant = np.unique(np.concatenate([_keys(self.node[s], len(self.free)) for s in stencils] + [_diagonal(len(self.free))]))
        self._keep(self._constant)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return 3 * len(self.free)

    def gather(self, field: Array) -> Array:
        """Free part of a field [..., V, 3] -> [..., size]."""
        return field[..., self.free, :].reshape(*field.shape[:-2], self.size)

    def scatter(self, values: Array) -> Array:
        """Field [..., V, 3] of free values [..., size], zero elsewhere."""
        out = np.zeros((*values.shape[:-1], len(self.node), 3))
        out[..., self.free, :] = values.reshape(*values.shape[:-1], -1, 3)
        return out

    def renew(self) -> None:
        """Back to the pattern of the constant stencils, once contact has moved on."""
        if len(self._blocks) > 1.5 * len(self._constant):
            self._keep(self._constant)

    @property
    def pattern(self) -> NDArray[np.int64]:
        """The blocks that are kept."""
        return self._blocks

    def take(self, pattern: NDArray[np.int64]) -> None:
        """Keep the blocks of another system of these nodes: the order of elimination, and with it the last bits, follow from them."""
        self._keep(pattern)

    def assemble(self, terms: Sequence[Blocks | csc_matrix]) -> csc_matrix:
        """Sum of Hessians on the free nodes, lower triangle."""
        for term in terms:
            if isinstance(term, Blocks):
                self._slots(term.stencils)  # the pattern grows where it lacks some, and with it the data
        data = np.zeros(9 * len(self._blocks))
        for term in terms:
            if isinstance(term, Blocks):
                slots = self._slots(term.stencils)
                _scatter_blocks(data, slots, self._base, self._stride, term.values)
            elif not self._add_sparse(data, term):
                self._grow(term)
                return self.assemble(terms)
        self._forget_all_but(terms)
        A = copy(self._empty)  # not made anew: scipy would examine the pattern every time
        A.data = data
        return A

    def factorise(self, A: csc_matrix) -> Factor:
        """Cholesky factor of an assembled matrix. Raises NotPositiveDefinite."""
        if self._symbolic is None:
            self._symbolic = _analyse(A)
        return self._symbolic(A)

    def _keep(self, blocks: NDArray[np.int64]) -> None:
        n = len(self.free)
        self._blocks = blocks  # sorted keys column · n + row, row ≥ column
        column, self._row = blocks // n, (blocks % n).astype(np.int32)
        self._pointer = np.searchsorted(column, np.arange(n + 1)).astype(np.int64)
        first = self._pointer[column]
        self._base = 9 * first + 3 * (np.arange(len(blocks)) - first)  # of a block's first entry in the scalar data
        self._stride = 3 * np.diff(self._pointer)[column]  # between the columns of a block
        indices, indptr = _expand(self._pointer, self._row)
        self._empty = csc_matrix((np.zeros(len(indices)), indices, indptr), shape=(self.size, self.size))
        self._symbolic = None
        self._known: dict[int, tuple[Indices, Array]] = {}

    def _add_sparse(self, data: Array, term: csc_matrix) -> bool:
        place = (self._pointer, self._row, self._base, self._stride)
        return _scatter_sparse(data, self.node, *place, term.indptr, term.indices, term.data)

    def _grow(self, term: csc_matrix) -> None:
        coo = term.tocoo()
        inside = (coo.row < 3 * len(self.node)) & (coo.col < 3 * len(self.node))
        i, j = self.node[coo.row[inside] // 3], self.node[coo.col[inside] // 3]
        wanted = _keys(np.stack([i, j], 1), len(self.free))
        self._keep(np.union1d(self._blocks, wanted))

    def _slots(self, stencils: Indices) -> NDArray[np.int64]:
        """Index of each block of each stencil in `_blocks`, −1 where it has no row or lies above the diagonal [K, m, m]."""
        known = self._known.get(id(stencils))
        if known is None or known[0] is not stencils:
            known = (stencils, self._find(stencils))
            self._known[id(stencils)] = known
        return known[1]

    def _forget_all_but(self, terms: Sequence[Blocks | csc_matrix]) -> None:
        """Keep the stencils of these terms and of those before, for exact and convex terms take turns. A term may bring new ones each time."""
        used = {id(term.stencils) for term in terms if isinstance(term, Blocks)}
        self._known = {key: known for key, known in self._known.items() if key in used | self._used}
        self._used = used

    def _find(self, stencils: Indices) -> NDArray[np.int64]:
        node = self.node[stencils].astype(np.int64)
        i, j = node[:, :, None], node[:, None, :]
        key = j * len(self.free) + i
        at = np.minimum(np.searchsorted(self._blocks, key), len(self._blocks) - 1)
        inside = (i >= j) & (j >= 0)
        if (self._blocks[at[inside]] != key[inside]).any():
            self._keep(np.union1d(self._blocks, key[inside]))
            return self._find(stencils)
        return np.where(inside, at, -1)


def _keys(node: NDArray, n: int) -> NDArray[np.int64]:
    """Keys of all pairs within each stencil of node numbers [K, m], row ≥ column, prescribed nodes (−1) left out."""
    i, j = np.broadcast_arrays(node[:, :, None].astype(np.int64), node[:, None, :].astype(np.int64))
    keep = (i >= j) & (j >= 0)
    return np.unique(j[keep] * n + i[keep])


def _diagonal(n: int) -> NDArray[np.int64]:
    return np.arange(n, dtype=np.int64) * (n + 1)


def _analyse(A: csc_matrix):
    """A function from matrices of the pattern of A to factors."""
    try:
        cholmod = load_cholmod()
    except ImportError:
        return _lu
    symbolic = cholmod.analyze(A, mode="supernodal", ordering_method="metis")  # half the fill of AMD on cloth

    def factorise(matrix: csc_matrix) -> Factor:
        try:
            with one_thread():
                factor = symbolic.cholesky(matrix)
        except cholmod.CholmodNotPositiveDefiniteError as error:
            raise NotPositiveDefinite from error
        return _Cholesky(factor)

    return factorise


class _Cholesky:
    def __init__(self, factor) -> None:
        self._factor = factor

    def solve(self, b: Array) -> Array:
        if b.ndim == 1 or b.shape[1] <= AT_ONCE:
            return self._factor(b)
        x = np.empty(b.shape, order="F")
        for first in range(0, b.shape[1], AT_ONCE):
            some = slice(first, first + AT_ONCE)
            x[:, some] = self._factor(b[:, some])
        return x


class _LU:
    def __init__(self, factor) -> None:
        self._factor = factor

    def solve(self, b: Array) -> Array:
        return self._factor.solve(np.ascontiguousarray(b))


def _lu(A: csc_matrix) -> Factor:
    from scipy.sparse import tril
    from scipy.sparse.linalg import splu

    factor = splu((tril(A) + tril(A, -1).T).tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    # with pivots on the diagonal the signs of U's diagonal are those of the eigenvalues (Sylvester)
    if not (factor.U.diagonal() > 0).all():
        raise NotPositiveDefinite
    return _LU(factor)


@njit(cache=True, nogil=True, error_model="numpy")
def _expand(pointer, row):
    """Scalar compressed columns of a block pattern."""
    n = len(pointer) - 1
    indices, indptr = np.empty(9 * len(row), np.int32), np.zeros(3 * n + 1, np.int32)
    at = 0
    for j in range(n):
        for c in range(3):
            for k in range(pointer[j], pointer[j + 1]):
                for r in range(3):
                    indices[at] = 3 * row[k] + r
                    at += 1
            indptr[3 * j + c + 1] = at
    return indices, indptr


@njit(cache=True, nogil=True, error_model="numpy")
def _scatter_blocks(data, slots, base, stride, values):
    K, m, _ = slots.shape
    for e in range(K):
        for q in range(m):
            for p in range(m):
                slot = slots[e, p, q]
                if slot >= 0:
                    for c in range(3):
                        for r in range(3):
                            data[base[slot] + c * stride[slot] + r] += values[e, 3 * p + r, 3 * q + c]


@njit(cache=True, nogil=True, error_model="numpy")
def _scatter_sparse(data, node, pointer, row, base, stride, indptr, indices, values):
    """Add the cloth part of a sparse matrix; False if an entry has no place."""
    for column in range(3 * len(node)):
        j = node[column // 3]
        if j < 0:
            continue
        last, slot = -1, -1
        for k in range(indptr[column], indptr[column + 1]):
            vertex = indices[k] // 3
            if vertex >= len(node):
                continue
            i = node[vertex]
            if i < j:
                continue
            if vertex != last:
                slot = pointer[j] + np.searchsorted(row[pointer[j] : pointer[j + 1]], i)
                if slot == pointer[j + 1] or row[slot] != i:
                    return False
                last = vertex
            data[base[slot] + (column % 3) * stride[slot] + indices[k] % 3] += values[k]
    return True
