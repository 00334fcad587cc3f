"""Vectors of space as tuples of three numbers: compiled, they cost no memory, which arrays of three do in every triangle and hinge."""

from numba import njit


@njit(cache=True, nogil=True)
def between(x, i, y, j):
    """From row i of x [V, 3] to row j of y [W, 3]."""
    return y[j, 0] - x[i, 0], y[j, 1] - x[i, 1], y[j, 2] - x[i, 2]


@njit(cache=True, nogil=True)
def dot(u, v):
    """u · v."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@njit(cache=True, nogil=True)
def cross(u, v):
    """u × v."""
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]
