"""The digits that C-IPC's recordings lost: positions were written with seven significant decimal digits, then stored as float32.

Where C-IPC leaves a saddle, that noise (5e-8 m where |x| > 0.1 m) decides how far it gets. Our step along its path gives the lost digits
back, wherever it rounds to the record; a collider that is rigid gets them from its rigid motion. Nothing is chosen: a number that the
record contradicts is not taken.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

Array = NDArray[np.float64]
DIGITS = 7


def restored(ours: Array, record: Array) -> Array:
    """`ours` wherever the record is what it rounds to, otherwise the record."""
    return np.where(np.abs(ours - record) <= rounding(record), ours, record)


def rounding(record: Array) -> Array:
    """Largest error of a number written with seven significant digits and stored as float32."""
    size = np.abs(record)
    unit = 10.0 ** (np.floor(np.log10(np.maximum(size, np.finfo(np.float32).tiny))) + 1 - DIGITS)
    return 0.5 * (unit + np.spacing(size.astype(np.float32)))


def share_done(shape: Array, now: Array, then: Array) -> float:
    """Share of the way to its targets at which C-IPC left its prescribed nodes: between 0.99 and 1.

    Its colliders are rigid, so the targets t = now + (then − now)/share [C, 3] m are congruent with `shape`; float32 shows it to 1e-5.
    """

    def misfit(share: float) -> float:
        target = now + (then - now) / share
        return float(np.sqrt(np.mean((moved(shape, target) - target) ** 2)))

    best = minimize_scalar(misfit, bounds=(0.99, 1.0), method="bounded", options={"xatol": 1e-6})
    return float(best.x) if best.fun < 0.9 * misfit(1.0) else 1.0


def moved(shape: Array, to: Array) -> Array:
    """`shape` [C, 3] under the rigid motion that brings it nearest to `to` [C, 3] (Kabsch 1976)."""
    a, b = shape - shape.mean(0), to - to.mean(0)
    U, _, Vt = np.linalg.svd(a.T @ b)
    turn = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return a @ turn + to.mean(0)


def rigid_shape(c: Array) -> Array:
    """Shape [C, 3] of a rigid collider recorded as c [T, C, 3]: the mean over the frames' targets, each moved onto the first frame."""
    targets = [c[0], *(now + (then - now) / share_done(c[0], now, then) for now, then in pairwise(c))]
    return np.mean([moved(target, c[0]) for target in targets], axis=0)
