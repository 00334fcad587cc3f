"""Distances of points, segments and triangles, and the algebra of vectors that they need, compiled, on tuples (x, y, z): no array is made
for any of them.

Source: Ericson 2005, Real-Time Collision Detection, §5.1.5 (point and triangle) and §5.1.9 (segments).
"""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def point_triangle(p, a, b, c):
    """Squared distance of p from triangle abc."""
    ab, ac, ap = minus(b, a), minus(c, a), minus(p, a)
    d1, d2 = dot(ab, ap), dot(ac, ap)
    if d1 <= 0 and d2 <= 0:
        return dot(ap, ap)
    bp = minus(p, b)
    d3, d4 = dot(ab, bp), dot(ac, bp)
    if d3 >= 0 and d4 <= d3:
        return dot(bp, bp)
    cp = minus(p, c)
    d5, d6 = dot(ab, cp), dot(ac, cp)
    if d6 >= 0 and d5 <= d6:
        return dot(cp, cp)
    opposite_c, opposite_b, opposite_a = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
    if opposite_c <= 0 and d1 >= 0 and d3 <= 0:
        r = along(ap, -d1 / (d1 - d3), ab)
    elif opposite_b <= 0 and d2 >= 0 and d6 <= 0:
        r = along(ap, -d2 / (d2 - d6), ac)
    elif opposite_a <= 0 and d4 >= d3 and d5 >= d6:
        r = along(bp, -(d4 - d3) / (d4 - d3 + d5 - d6), minus(c, b))
    else:
        whole = opposite_a + opposite_b + opposite_c
        r = along(along(ap, -opposite_b / whole, ab), -opposite_c / whole, ac)
    return dot(r, r)


@njit(cache=True, nogil=True, error_model="numpy")
def between_segments(a, b, c, d):
    """The shortest vector from segment ab to segment cd."""
    ab, cd, ca = minus(b, a), minus(d, c), minus(a, c)
    A, E, f, C, B = dot(ab, ab), dot(cd, cd), dot(cd, ca), dot(ab, ca), dot(ab, cd)
    det = A * E - B * B
    s = min(max((B * f - C * E) / det, 0.0), 1.0) if det > 1e-12 * A * E else 0.0
    t = (B * s + f) / E
    if t < 0:
        t, s = 0.0, min(max(-C / A, 0.0), 1.0)
    elif t > 1:
        t, s = 1.0, min(max((B - C) / A, 0.0), 1.0)
    return along(along(scaled(-1.0, ca), t, cd), -s, ab)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def minus(a, b):
    """a − b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def plus(a, b):
    """a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def scaled(t, a):
    """t a."""
    return t * a[0], t * a[1], t * a[2]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def along(a, t, b):
    """a + t b."""
    return a[0] + t * b[0], a[1] + t * b[1], a[2] + t * b[2]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def dot(a, b):
    """a·b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def length(a):
    """‖a‖."""
    return np.sqrt(dot(a, a))


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def cross(a, b):
    """a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def row(x, i):
    """x_i of an array [V, 3]."""
    return x[i, 0], x[i, 1], x[i, 2]
