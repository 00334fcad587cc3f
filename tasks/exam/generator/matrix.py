"""The sparse matrix of Newton's method on the free nodes: every element knows the places of its entries.

Solved by conjugate gradients, preconditioned with the Cholesky factor of an earlier matrix; a new factor is made when the old one has aged.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from tasks.geometry.cholmod_kernels import load_cholmod, one_thread

Array = NDArray[np.float64]
Indices = NDArray[np.int32]
EXACT = 1e-3  # relative residual of a solution
AGED = 12  # iterations that a factor may need

cholmod = load_cholmod()


class Indefinite(ArithmeticError):
    """The matrix is not positive definite."""


class Matrix:
    """Lower triangle of a matrix over the free ones of V nodes, coupled by stencils [K, m]; nodes of `pinned` have no rows."""

    def __init__(self, vertex_count: int, pinned: Indices, stencils: Sequence[Indices]) -> None:
        self.free = np.setdiff1d(np.arange(vertex_count), pinned)
        node = np.full(vertex_count, -1)
        node[self.free] = np.arange(len(self.free))
        self._dof = np.where(node[:, None] < 0, -1, 3 * node[:, None] + np.arange(3))
        self.size = 3 * len(self.free)
        keys = [self._keys(s) for s in (*stencils, np.arange(vertex_count)[:, None])]
        known = np.unique(np.concatenate([k.ravel() for k in keys]))
        known = known[known >= 0]
        self.slots = [np.where(k >= 0, np.searchsorted(known, k), -1).astype(np.int32) for k in keys]  # the last: nodes by themselves
        self._indices = (known % self.size).astype(np.int32)
        self._indptr = np.searchsorted(known // self.size, np.arange(self.size + 1)).astype(np.int32)
        self.entries = len(known)
        self._symbolic = None
        self._factor = None

    def add_nodes(self, data: Array, blocks: Array) -> None:
        """Add blocks [V, 3, 3] on the diagonal."""
        _add(data, self.slots[-1], blocks)

    def solve(self, data: Array, extra: csc_matrix | None, b: Array) -> Array:
        """Solution [V, 3], zero where pinned, for right side b [V, 3]; `extra` [3V, 3V] is added. Raises Indefinite."""
        if extra is not None:
            dof = (3 * self.free[:, None] + np.arange(3)).ravel()
            extra = extra.tocsr()[dof][:, dof]
        rhs = b[self.free].ravel()
        x = None if self._factor is None else self._conjugate_gradients(data, extra, rhs, AGED)
        if x is None:
            self._factorise(data)
            x = self._conjugate_gradients(data, extra, rhs, 200)
        if x is None:
            raise Indefinite
        out = np.zeros_like(b)
        out[self.free] = x.reshape(-1, 3)
        return out

    def _conjugate_gradients(self, data: Array, extra: csc_matrix | None, b: Array, most: int) -> Array | None:
        """None where `most` iterations do not suffice or the matrix turns out indefinite."""
        x, r = np.zeros_like(b), b.copy()
        z = self._factor(r)
        p, rz = z.copy(), r @ z
        goal = EXACT**2 * (b @ b)
        for _ in range(most):
            Ap = _times(self._indptr, self._indices, data, p)
            if extra is not None:
                Ap += extra @ p
            curvature = p @ Ap
            if curvature <= 0:
                return None
            α = rz / curvature
            x += α * p
            r -= α * Ap
            if r @ r <= goal:
                return x
            z = self._factor(r)
            rz, old = r @ z, rz
            p = z + rz / old * p
        return None

    def _factorise(self, data: Array) -> None:
        A = csc_matrix((data, self._indices, self._indptr), shape=(self.size, self.size))
        self._symbolic = self._symbolic or cholmod.analyze(A, mode="supernodal", ordering_method="metis")
        try:
            with one_thread():
                self._factor = self._symbolic.cholesky(A)
        except cholmod.CholmodNotPositiveDefiniteError:
            self._factor = None
            raise Indefinite from None

    def _keys(self, stencil: Indices) -> NDArray[np.int64]:
        dof = self._dof[stencil].reshape(len(stencil), -1).astype(np.int64)
        i, j = dof[:, :, None], dof[:, None, :]
        return np.where((i >= j) & (j >= 0), j * self.size + i, -1)


@njit(cache=True, nogil=True)
def _times(indptr, indices, data, x):
    """Product of a symmetric matrix, given by its lower triangle, with x."""
    out = np.zeros_like(x)
    for j in range(len(x)):
        total = 0.0
        for k in range(indptr[j], indptr[j + 1]):
            i = indices[k]
            total += data[k] * x[i]
            if i != j:
                out[i] += data[k] * x[j]
        out[j] += total
    return out


@njit(cache=True, nogil=True)
def _add(data, slots, blocks):
    for v in range(len(slots)):
        for p in range(3):
            for q in range(3):
                if slots[v, p, q] >= 0:
                    data[slots[v, p, q]] += blocks[v, p, q]
