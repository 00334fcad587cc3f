"""The frame rate of the frames that are read. A recording has one, and every velocity further on is taken by it.

    rate = fps / k,     k = n_{i+1} − n_i for all i          n frame numbers, fps the rate of consecutive numbers

Frames that stand unevenly have no rate and are refused: a gap read as one step doubles the speed there, and the acceleration more.
"""

from statistics import mode

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.faults import Fault


def rate_of(numbers: NDArray[np.integer], fps: float) -> float:
    """Frames per second of evenly spaced `numbers` [frame], increasing, of a recording with `fps`; of a single frame, `fps`."""
    return fps / _spacing(numbers)


def rate_warnings(numbers: NDArray[np.integer], fps: float) -> list[str]:
    """A sentence where frames that are not consecutive change the rate; arguments as in `rate_of`."""
    k = _spacing(numbers)
    if k == 1:
        return []
    return [f"The frames read stand {k} apart: {fps:g} frames per second of consecutive numbers are {rate_of(numbers, fps):g} of these."]


def spacing_faults(numbers: NDArray[np.integer], where: str) -> list[Fault]:
    """A fault that names the first gap, unless neighbours among `numbers` [frame], increasing, stand equally far apart."""
    k = _spacing(numbers)
    odd = np.flatnonzero(np.diff(numbers) != k)
    if not len(odd):
        return []
    before, after = numbers[odd[0]], numbers[odd[0] + 1]
    what = f"frame {after} follows frame {before}, where others stand {k} apart, and a recording has one frame rate"
    remedy = "Copy what is missing, stop at the gap or begin after it, or select evenly spaced frames (capture.frames)."
    return [Fault(where, what, remedy)]


def _spacing(numbers: NDArray[np.integer]) -> int:
    """The commonest distance between neighbours; 1 where there is a single frame."""
    return mode(np.diff(numbers).tolist() or [1])
