"""What can be wrong with a file for a diagnosis, beyond what is wrong with any tracked garment (`capture/tracked_geometry_checks.py`)."""

import numpy as np
from numpy.typing import NDArray

from tasks.capture.tracked_geometry import TrackedGeometry
from tasks.cloth.tracked_scene import LEAST_SEEN
from tasks.gap.blind import GIVEN
from tasks.geometry.faults import Fault

FEWEST_FRAMES = 8
SLOWEST_FPS = 10.0  # [1/s]: fewer frames leave windows of a fifth of a second empty
SIZES = (0.1, 5.0)  # [m] of a garment, largest extent
NEVER = 0.5  # largest share of vertices that no frame shows
ONE_GARMENT = "Several recordings must share one garment."


def recording_faults(track: TrackedGeometry, name: str, *, first: TrackedGeometry | None = None, blind: bool = False) -> list[Fault]:
    """Of one file by itself, and beside the `first` one of the same garment. A blind one shows the garment in its first frames only."""
    if track.vertices is None or not np.isfinite(track.vertices).any():
        return [Fault(f"{name}: vertices", "are absent", "The diagnosis needs the tracked surface, not only markers.")]
    faults = _extent_faults(track, name) + (_blind_faults(track, name) if blind else _seen_faults(track, name))
    return faults if first is None or first is track else faults + _other_garment_faults(track, first, name)


def driven_faults(track: TrackedGeometry, driven: NDArray[np.int32], name: str) -> list[Fault]:
    """Where the driven vertices [B] are not known."""
    unknown = np.argwhere(~np.isfinite(track.vertices[:, driven]).all(-1))
    if not len(unknown):
        return []
    t, k = unknown[0]
    frames = len(np.unique(unknown[:, 0]))
    what = f"driven vertex {driven[k]} is not known in frame {t}; {frames} of {len(track.vertices)} frames lack some"
    return [Fault(f"{name}: vertices", what, "Give the boundary for all frames.")]


def _extent_faults(track: TrackedGeometry, name: str) -> list[Fault]:
    """In time and space."""
    faults = []
    if len(track.vertices) < FEWEST_FRAMES:
        faults.append(Fault(f"{name}: vertices", f"{len(track.vertices)} frames", f"Give at least {FEWEST_FRAMES}."))
    if track.fps < SLOWEST_FPS:
        faults.append(Fault(f"{name}: fps", f"{track.fps:g} frames per second", f"Give at least {SLOWEST_FPS:g}; cloth swings faster."))
    whole = np.flatnonzero(np.isfinite(track.vertices).all((1, 2)))
    extent = float(np.ptp(track.vertices[whole[0]], axis=0).max()) if len(whole) else SIZES[0]
    if not SIZES[0] <= extent <= SIZES[1]:
        faults.append(Fault(f"{name}: vertices", f"the garment is {extent:.3g} m large", "Give metres."))
    return faults


def _seen_faults(track: TrackedGeometry, name: str) -> list[Fault]:
    seen = track.observed & np.isfinite(track.vertices).all(2)
    seen = np.delete(seen, track.boundary, 1)
    if not seen.size:
        return [Fault(f"{name}: boundary", "names every vertex", "Name those that are held; the others are what is compared.")]
    never, share = np.count_nonzero(~seen.any(0)), float(seen.mean())
    if never > NEVER * seen.shape[1]:
        what = f"{never} of {seen.shape[1]} free vertices are never seen"
        return [Fault(f"{name}: vertices", what, "Give a track of the whole garment, or cut the mesh to what was tracked.")]
    if share < LEAST_SEEN:
        what = f"only {share:.0%} of the positions of the free vertices are seen"
        return [Fault(f"{name}: vertices", what, f"Give frames that show at least {LEAST_SEEN:.0%}.")]
    return []


def _blind_faults(track: TrackedGeometry, name: str) -> list[Fault]:
    known = np.isfinite(track.vertices).all(2)
    short = [t for t in range(min(GIVEN, len(known))) if known[t].mean() < 1 - NEVER]
    if not short:
        return []
    what = f"{known[short[0]].mean():.0%} of the garment are known in frame {short[0]}"
    return [Fault(f"{name}: vertices", what, f"A prediction starts from the garment in its first {GIVEN} frames.")]


def _other_garment_faults(track: TrackedGeometry, first: TrackedGeometry, name: str) -> list[Fault]:
    faults = []
    if not np.array_equal(track.faces, first.faces):
        what = f"{len(track.faces)} faces, the first file has {len(first.faces)} or others"
        faults.append(Fault(f"{name}: faces", what, ONE_GARMENT))
    elif len(track.boundary) and len(first.boundary) and not np.array_equal(track.boundary, first.boundary):
        faults.append(Fault(f"{name}: boundary", "differs from the first file's", ONE_GARMENT))
    if track.fps != first.fps:
        faults.append(Fault(f"{name}: fps", f"{track.fps:g}, the first file has {first.fps:g}", "Resample one of them."))
    return faults
