"""Tracked files of one garment as what the diagnosis works on: the garment, and a recording per file.

All files show the same mesh with the same boundary; the first one's rest shape, zones and weight hold for all, and so does the boundary of
the first that names one, or the one chosen for the first. Each file has a collider of its own. Where a file names no zones, the borders
that are not driven are hems, cuts of the pattern are seams, and what lies on the body is contact. The driven nodes are freed of the
tracker's noise, but for what a worn rest shape has of it (`driven_motion.py`). The collider is drawn in for the coarse mesh only
(`cloth/contact_sagitta.py`), not, as where a fabric is fitted, until the garment is clear of it: that would hide a body in the wrong place.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.capture.tracked_geometry import TrackedGeometry
from tasks.cloth.contact_sagitta import contact_sagitta, drawn_in
from tasks.cloth.driven_motion import WornRest, quieted
from tasks.cloth.frame_rate import steps_per_frame
from tasks.cloth.known_vertices import known_vertices
from tasks.cloth.start_state import filled
from tasks.cloth.stated_noise import noise_of
from tasks.cloth.tracked_scene import TrackedScene, tracked_scene, worn_at_rest
from tasks.cloth.windows import Recording
from tasks.effects.effect import Motion, Subject
from tasks.effects.model import Model
from tasks.gap.recording_faults import driven_faults, recording_faults
from tasks.gap.zones import ZONES, zones
from tasks.geometry.distances import closest_points
from tasks.geometry.faults import BadInput, refuse
from tasks.simulator import NO_COLLIDER, Cloth, Collider, Settings

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Garment:
    """The base model of the garment to start from, its recordings, sentences on what was chosen, and the first file with the boundary
    chosen.

    contact_doubt [m]: by how much the bodies of all recordings were drawn in because the mesh is coarse (`cloth/contact_sagitta.py`).
    rest: the driven nodes where the first frame of the first file is the rest shape.
    """

    model: Model
    recordings: tuple[Recording, ...]
    chosen: tuple[str, ...]
    first: TrackedGeometry
    contact_doubt: float
    rest: WornRest | None = None


def garment_recordings(
    tracks: Sequence[TrackedGeometry], names: Sequence[str], *, blind: tuple[TrackedGeometry, str] | None = None
) -> Garment:
    """Of files and the `names` that stand in messages. Raises BadInput with every fault of every file, a `blind` one of the same garment among them."""
    faults = [f for track, name in zip(tracks, names, strict=True) for f in recording_faults(track, name, first=tracks[0])]
    refuse(faults + (recording_faults(*blind, first=tracks[0], blind=True) if blind else []))
    filled_tracks, scenes = _scenes(tracks, names)
    first = scenes[0].scene
    settings = Settings(substeps=steps_per_frame(first.fps), yield_collider=False)
    subject = Subject(first.cloth, scenes[0].fabric, first.collider, _zones(tracks[0], first), first.fps)
    rest = _rest(filled_tracks[0], first.cloth) if worn_at_rest(tracks[0]) else None
    recordings = tuple(_recording(t, _driven(whole, first.cloth, rest)) for t, whole in zip(tracks, filled_tracks, strict=True))
    doubt = contact_sagitta(first.cloth, recordings, settings.barrier_distance)
    recordings = tuple(drawn_in(r, doubt) for r in recordings)
    return Garment(Model(subject, settings), recordings, scenes[0].chosen, replace(tracks[0], boundary=first.cloth.boundary), doubt, rest)


def recording(track: TrackedGeometry, name: str, of: Garment, *, blind: bool = False) -> Recording:
    """A further file of the same garment; a blind one shows the garment in its first frames only. Raises BadInput with every fault."""
    driven = of.model.subject.cloth.boundary
    track = track if len(track.boundary) else replace(track, boundary=driven)
    refuse(recording_faults(track, name, first=of.first, blind=blind) or driven_faults(track, driven, name))
    return drawn_in(_recording(track, _driven(track, of.model.subject.cloth, of.rest)), of.contact_doubt)


def _driven(track: TrackedGeometry, cloth: Cloth, rest: WornRest | None) -> Array:
    """The motion [T, B, 3] m of the driven nodes, the same way for recordings that teach, that are held out and that are blind."""
    quiet = _quieted(track, cloth)
    return quiet if rest is None else rest.kept(quiet)


def _rest(first: TrackedGeometry, cloth: Cloth) -> WornRest:
    return WornRest(cloth.x_rest[cloth.boundary], _quieted(first, cloth)[0])


def _quieted(track: TrackedGeometry, cloth: Cloth) -> Array:
    return quieted(track.vertices[:, cloth.boundary], float(np.median(noise_of(track))), cloth.x_rest[cloth.boundary])


def _scenes(tracks: Sequence[TrackedGeometry], names: Sequence[str]) -> tuple[list[TrackedGeometry], list[TrackedScene]]:
    """Every file without gaps, and its scene, all driven at the same nodes; faults of all are told together."""
    whole, scenes, faults = [], [], []
    driven = next((track.boundary for track in tracks if len(track.boundary)), tracks[0].boundary)
    for track, name in zip(tracks, names, strict=True):
        try:
            whole.append(_whole(track, driven))
            scenes.append(tracked_scene(whole[-1], name=name))
        except BadInput as bad:
            faults += bad.faults
            continue
        driven = scenes[0].scene.cloth.boundary
    refuse(faults)
    return whole, scenes


def _recording(track: TrackedGeometry, boundary: Array) -> Recording:
    """With the collider as the file has it: where the garment pokes through it, that is evidence."""
    collider, motion = NO_COLLIDER, np.zeros((len(track.vertices), 0, 3))
    if track.collider_vertices is not None:
        collider, motion = Collider(track.collider_faces), track.collider_vertices
    observed = np.where(track.observed[..., None], track.vertices, np.nan)
    return Recording(collider, Motion(motion, boundary), observed, noise_of(track))


def _whole(track: TrackedGeometry, driven: NDArray[np.int32]) -> TrackedGeometry:
    """The track without gaps, driven at these nodes [B]: a start and a boundary need every vertex. What fills a gap counts as seen, with the
    median noise.
    """
    stated = track.noise_m is not None or track.noise_cov is not None
    return replace(
        track,
        boundary=driven,
        vertices=filled(known_vertices(track), track.faces)[0],
        observed=np.ones_like(track.observed),
        noise_m=noise_of(track) if stated else None,
        noise_cov=None,
    )


def _zones(track: TrackedGeometry, scene) -> NDArray[np.str_]:
    if track.zone is not None:
        return track.zone
    pinned = np.isin(np.arange(track.vertices.shape[1]), scene.cloth.boundary)
    near = np.full(track.vertices.shape[:2], np.inf)
    if scene.collider_motion.shape[1]:
        x = np.nan_to_num(track.vertices, nan=1e3)
        near = np.stack([closest_points(a, b, scene.collider.faces).distance for a, b in zip(x, scene.collider_motion, strict=True)])
    return np.array(ZONES)[zones(track.faces, None, near, pinned)]
