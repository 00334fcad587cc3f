"""The windows on which a diagnosis compares before and after, each with its own residuals.

A diagnosis keeps the residuals of these windows one after another; which frames they are follows from how recordings are cut.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.windows import Recording, Window, windows
from tasks.gap.diagnosis import Diagnosis
from tasks.gap.gathered import Gathered, split
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


def stretches(found: Diagnosis, recordings: Sequence[Recording], held_out: Sequence[Recording] | None) -> tuple[Stretch, ...]:
    """In the order of `found.before`; none where a window was lost on the way, so that frames can no longer be told."""
    cut = _compared(found, recordings, held_out)
    ends = np.cumsum([w.length for w in cut])
    if not cut or not ends[-1] == len(found.before) == len(found.after):
        return ()
    return tuple(Stretch(w, found.before[b - w.length : b], found.after[b - w.length : b]) for w, b in zip(cut, ends, strict=True))


def _compared(found: Diagnosis, recordings: Sequence[Recording], held_out: Sequence[Recording] | None) -> list[Window]:
    if found.screened is None:
        return []
    if not found.shrinkage.held_out:
        return [e.prediction.window for e in found.screened.evidence if e.residual is not None]
    fps = found.base.subject.fps
    if held_out is not None:
        return windows(held_out, fps)
    return list(split(Gathered(tuple(recordings), (), tuple(windows(recordings, fps))))[1].windows)
