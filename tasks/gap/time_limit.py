"""How long one simulation of a diagnosis may take before it counts as hung.

    limit = limit of a second · max(1, T/fps)        T frames of the longest recording that is known when it begins

Windows last a third of a second, but states, replays and what is predicted blind go through a whole recording in one computation, so what
is too long for a window is not for these.
"""

from collections.abc import Iterable

from tasks.cloth.windows import Recording


def time_limit(second_s: float, recordings: Iterable[Recording], fps: float) -> float:
    """[s] of one computation, where one second of a recording may take `second_s` [s]."""
    return second_s * max(1.0, max(len(r) for r in recordings) / fps)
