"""The windows on which a diagnosis compares before and after, each with its own residuals.

A diagnosis keeps the residuals of these windows one after another.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.windows import Window
from tasks.gap.diagnosis import Diagnosis
from tasks.gap.residual import rms_mm

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Stretch:
    """A window and its residuals before, after [L, V, 3] m."""

    window: Window
    before: Array
    after: Array

    @property
    def before_mm(self) -> float:
        """Root mean square distance of a vertex."""
        return rms_mm(self.before)

    @property
    def after_mm(self) -> float:
        """The same with the named effect."""
        return rms_mm(self.after)


def stretches(found: Diagnosis) -> tuple[Stretch, ...]:
    """In the order of `found.before`; none where a window was lost on the way, so that frames can no longer be told."""
    ends = np.cumsum([w.length for w in found.compared])
    if not len(ends) or not ends[-1] == len(found.before) == len(found.after):
        return ()
    return tuple(
        Stretch(w, found.before[b - w.length : b], found.after[b - w.length : b]) for w, b in zip(found.compared, ends, strict=True)
    )
