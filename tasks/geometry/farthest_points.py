"""Points spread evenly over a surface: each one the farthest from those chosen before.

Source: Gonzalez 1985. No choice of as many covers the surface with balls of less than half the radius.
"""

import numpy as np
from numpy.typing import NDArray


def farthest_points(x: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Numbers of `count` of the points x [V, 3] in ascending order; of all where there are no more."""
    if len(x) <= count:
        return np.arange(len(x))
    chosen, squared = np.empty(count, np.int64), np.full(len(x), np.inf)
    at = int(np.argmax(np.sum((x - x.mean(0)) ** 2, 1)))
    for k in range(count):
        chosen[k] = at
        squared = np.minimum(squared, np.sum((x - x[at]) ** 2, 1))
        at = int(np.argmax(squared))
    return np.sort(chosen)
