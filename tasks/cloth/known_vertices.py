"""Where a file of tracked geometry says that the garment was.

A vertex that was not observed is not known, whatever number stands there: trackers write zeros, or the last place they saw. Those of the
file's boundary are the exception: they drive the cloth, and something else than the garment's own picture may have told where they are.

A fit starts from a frame that is wholly known. Where there is none, as of a tracker that says in every frame what was hidden, it is the
frame that is known best, its gaps filled from the frames around it.
"""

import numpy as np
from numpy.typing import NDArray

from tasks.capture.tracked_geometry import TrackedGeometry
from tasks.cloth.start_state import filled

Array = NDArray[np.float64]


def known_vertices(track: TrackedGeometry) -> Array:
    """[T, V, 3] m, NaN where not known."""
    known = track.observed.copy()
    known[:, track.boundary] = True
    return np.where(known[..., None], track.vertices, np.nan)


def first_frame(vertices: Array) -> int:
    """Where to start in vertices [T, V, 3] m, NaN where not known: the first whole frame, else the best known one of the first half."""
    known = np.isfinite(vertices).all(2).sum(1)
    whole = np.flatnonzero(known == vertices.shape[1])
    return int(whole[0] if len(whole) else known[: (len(known) + 1) // 2].argmax())


def from_whole(vertices: Array, faces: NDArray[np.int32], first: int) -> tuple[Array, int]:
    """The frames from the first one on [T, V, 3] m, that one filled in from those around it, and how many of its vertices were."""
    missing = int((~np.isfinite(vertices[first]).all(1)).sum())
    if not missing:
        return vertices[first:], 0
    return np.concatenate([filled(vertices, faces)[0][first : first + 1], vertices[first + 1 :]]), missing
