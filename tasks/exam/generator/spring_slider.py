"""Friction within the fabric: a spring in series with a slider (Prandtl's element), which follows a displacement and gives way at ±limit.

Rate-independent; a sharp corner where it gives way, and nothing but the force is remembered.
"""

from numba import njit


@njit(cache=True, nogil=True)
def spring_slider(z0, dq, limit, reach):
    """Force after a displacement by dq from where it was z0, and its derivative in dq; reach: displacement that builds up `limit`."""
    z = z0 + limit / reach * dq
    if z > limit:
        return limit, 0.0
    if z < -limit:
        return -limit, 0.0
    return z, limit / reach
