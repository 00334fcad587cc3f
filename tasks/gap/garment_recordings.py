"""Tracked files of one garment as what the diagnosis works on: the garment, and a recording per file.

All files show the same mesh with the same boundary; the first one's rest shape, zones and weight hold for all. Where a file names no zones, the
borders that are not driven are hems, cuts of the pattern are seams, and what lies on the body is contact. The driven nodes are freed of the
tracker's noise (`driven_motion.py`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.capture.tracked_geometry import TrackedGeometry
from tasks.cloth.driven_motion import quieted
from tasks.cloth.start_state import filled
from tasks.cloth.tracked_scene import NOISE_M, tracked_scene
from tasks.cloth.windows import Recording
from tasks.effects.effect import Motion, Subject
from tasks.effects.model import Model
from tasks.gap.zones import ZONES, zones
from tasks.geometry.distances import closest_points
from tasks.geometry.faults import Fault, refuse
from tasks.simulator import Settings

Array = NDArray[np.float64]

LONGEST_STEP = 0.01  # [s]
FEWEST_FRAMES = 8
SIZES = (0.1, 5.0)  # [m] of a garment, largest extent
TALLER = 1.5  # times as deep as high: a garment that hangs is not


@dataclass(frozen=True)
class Garment:
    """The base model of the garment to start from, its recordings, and sentences on what was chosen."""

    model: Model
    recordings: tuple[Recording, ...]
    chosen: tuple[str, ...]


def garment_recordings(tracks: Sequence[TrackedGeometry], names: Sequence[str]) -> Garment:
    """Raises BadInput with every fault of every file."""
    refuse([fault for track, name in zip(tracks, names, strict=True) for fault in _faults(track, tracks[0], name)])
    scenes = [tracked_scene(_whole(track), name=name) for track, name in zip(tracks, names, strict=True)]
    first = scenes[0].scene
    settings = Settings(substeps=max(1, int(np.ceil(1 / (first.fps * LONGEST_STEP) - 1e-9))), yield_collider=False)
    subject = Subject(first.cloth, scenes[0].fabric, first.collider, _zones(tracks[0], first), first.fps)
    recordings = tuple(_recording(track, s.scene) for track, s in zip(tracks, scenes, strict=True))
    return Garment(Model(subject, settings), recordings, scenes[0].chosen)


def recording(track: TrackedGeometry, name: str, of: Garment, *, blind: bool = False) -> Recording:
    """A further file of the same garment; a blind one shows the garment in its first frames only."""
    subject = of.model.subject
    refuse(_faults(track, None, name, blind=blind) + _other_mesh(track, subject.cloth.faces, name))
    collider = track.collider_vertices if track.collider_vertices is not None else np.zeros((len(track.vertices), 0, 3))
    boundary = track.vertices[:, subject.cloth.boundary]
    if not np.isfinite(boundary).all():
        refuse([Fault(f"{name}: vertices", "the driven vertices are not known in every frame", "Give the boundary for all frames.")])
    noise = _noise(track)
    observed = np.where(track.observed[..., None], track.vertices, np.nan)
    return Recording(Motion(collider, quieted(boundary, float(np.median(noise)))), observed, noise)


def _recording(track: TrackedGeometry, scene) -> Recording:
    noise = scene.noise_m
    observed = np.where(track.observed[..., None], track.vertices, np.nan)
    return Recording(Motion(scene.collider_motion, quieted(scene.boundary_motion, float(np.median(noise)))), observed, noise)


def _whole(track: TrackedGeometry) -> TrackedGeometry:
    """The track without gaps: a start and a boundary need every vertex."""
    known = np.where(track.observed[..., None], track.vertices, np.nan)
    return replace(track, vertices=filled(known, track.faces)[0])


def _noise(track: TrackedGeometry) -> Array:
    if track.noise_cov is not None:
        return np.sqrt(np.maximum(np.trace(track.noise_cov, axis1=2, axis2=3), 1e-10) / 3)
    return np.full(track.vertices.shape[:2], NOISE_M) if track.noise_m is None else np.maximum(track.noise_m, 1e-5)


def _zones(track: TrackedGeometry, scene) -> NDArray[np.str_]:
    if track.zone is not None:
        return track.zone
    pinned = np.isin(np.arange(track.vertices.shape[1]), scene.cloth.boundary)
    near = np.full(track.vertices.shape[:2], np.inf)
    if scene.collider_motion.shape[1]:
        x = np.nan_to_num(track.vertices, nan=1e3)
        near = np.stack([closest_points(a, b, scene.collider.faces).distance for a, b in zip(x, scene.collider_motion, strict=True)])
    return np.array(ZONES)[zones(track.faces, None, near, pinned)]


def _faults(track: TrackedGeometry, first: TrackedGeometry | None, name: str, *, blind: bool = False) -> list[Fault]:
    faults = []
    if track.vertices is None or not np.isfinite(track.vertices).any():
        return [Fault(f"{name}: vertices", "are absent", "The diagnosis needs the tracked surface, not only markers.")]
    if len(track.vertices) < FEWEST_FRAMES:
        faults.append(Fault(f"{name}: vertices", f"{len(track.vertices)} frames", f"Give at least {FEWEST_FRAMES}."))
    never = np.flatnonzero(~np.isfinite(track.vertices).all(2).any(0))
    if len(never) > 0.5 * track.vertices.shape[1]:
        faults.append(
            Fault(f"{name}: vertices", f"{len(never)} of {track.vertices.shape[1]} are never seen", "Give a track of the whole garment.")
        )
    faults += _size_faults(track, name)
    if first is not None and first is not track:
        faults += _other_mesh(track, first.faces, name)
        if not np.array_equal(track.boundary, first.boundary):
            faults.append(Fault(f"{name}: boundary", "differs from the first file's", "Several recordings must share one garment."))
        if track.fps != first.fps:
            faults.append(Fault(f"{name}: fps", f"{track.fps:g}, the first file has {first.fps:g}", "Resample one of them."))
    return faults


def _size_faults(track: TrackedGeometry, name: str) -> list[Fault]:
    known = track.vertices[np.isfinite(track.vertices).all(2).all(1)]
    if not len(known):
        return []
    extent = float((known[0].max(0) - known[0].min(0)).max())
    if not SIZES[0] <= extent <= SIZES[1]:
        return [Fault(f"{name}: vertices", f"the garment is {extent:.3g} m large", "Give metres.")]
    return []


def _other_mesh(track: TrackedGeometry, faces: NDArray, name: str) -> list[Fault]:
    if np.array_equal(track.faces, faces):
        return []
    return [
        Fault(
            f"{name}: faces",
            f"{len(track.faces)} faces, the first file has {len(faces)} or others",
            "Several recordings must share one garment.",
        )
    ]
