"""Track a sequence frame by frame: reference colours from frame 0, start by prediction or constant velocity, one fit per frame.

Start of frame t: x_{t−1} + (p_t − p_{t−1}) where a prediction p is given (skin carried by the fitted body), else 2x_{t−1} − x_{t−2}. A
vertex whose prediction is NaN in one of the two frames moves on by constant velocity.

Resuming from the state after any frame gives the same bits as an uninterrupted run: the state is the last two frames, everything else
comes from frame 0.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.cameras import Cameras
from tasks.geometry.faults import BadInput, Fault
from tasks.geometry.meshes import mesh_faults
from tasks.read_ahead import read_ahead
from tasks.tracking import noise, outline, photometric, pyramid, reference
from tasks.tracking.gauss_newton import Fit, Instant, Scene, fit, linearise, look, pixel_size
from tasks.tracking.inside_skin import depth_in_skin
from tasks.tracking.pyramid import Images, Level
from tasks.tracking.settings import Settings
from tasks.tracking.surface import Shape, Surface, shape, surface
from tasks.tracking.visibility import Occluder, facing_cosines

Array = NDArray[np.float64]

_EYES = 2  # cameras that must see something around a vertex for it to count as seen


@dataclass(frozen=True)
class TrackedFrame:
    """One frame. vertices [V, 3] m; seen [V]; noise_m [V] standard deviation per coordinate, of what is seen;
    photometric_rms of the finest level; how it ended.
    """

    frame: int
    vertices: Array
    seen: NDArray[np.bool_]
    noise_m: Array
    photometric_rms: float
    ending: str


@dataclass(frozen=True)
class State:
    """Where to go on: the last frame done and the vertices of the last two [V, 3] m (the same twice after frame 0)."""

    frame: int
    before: Array
    last: Array


@dataclass(frozen=True)
class Tracked:
    """All frames done in this call, from `first` on. vertices [T, V, 3] m; seen, noise_m [T, V]; photometric_rms [T]; ending [T]."""

    first: int
    vertices: Array
    seen: NDArray[np.bool_]
    noise_m: Array
    photometric_rms: Array
    ending: tuple[str, ...]
    state: State


def track_sequence(
    images: Images,
    masks: Images | None,
    cameras: Cameras,
    template: Array,
    faces: NDArray[np.integer],
    *,
    frames: int,
    part: NDArray[np.str_] | None = None,
    prediction: Array | None = None,
    occluder: tuple[Array, NDArray[np.integer]] | None = None,
    settings: Settings | None = None,
    start: State | None = None,
    on_frame: Callable[[TrackedFrame, State], None] | None = None,
) -> Tracked:
    """Follow the template [V, 3] m, faces [F, 3] (the surface in frame 0) through `frames` frames of calibrated images.

    images(frame, camera) -> [height, width, 3]; masks likewise [height, width] or None, both asked for one frame ahead, from a thread;
    part [F] names ("body" is skin, all else cloth); prediction [T, V, 3] m, NaN where there is none; occluder (vertices [T, C, 3] m, faces
    [G, 3]) hides samples without being tracked; `start` resumes after its frame; `on_frame` is called after each frame with what was found
    and with the state to resume from. Raises BadInput.
    """
    settings = settings or Settings()
    part = np.full(len(faces), "garment") if part is None else np.asarray(part)
    _refuse_bad(template, faces, frames=frames, part=part, prediction=prediction, occluder=occluder, start=start)
    done = []
    for found, state in _frames(
        images, masks, cameras, np.asarray(template, float), faces, frames, part, prediction, occluder, settings, start
    ):
        done.append(found)
        if on_frame is not None:
            on_frame(found, state)
    return _collected(done, state if done else start)


def _frames(
    images, masks, cameras, template, faces, frames, part, prediction, occluder, settings, start
) -> Iterator[tuple[TrackedFrame, State]]:
    mesh = surface(template, faces, part, settings)
    first = pyramid.stack(images, masks, 0, cameras)
    levels = [pyramid.level(first, blur) for blur in settings.blur_px]
    cosine = facing_cosines(
        template, mesh, cameras, occluder=_at(occluder, 0), side=None, facing=settings.facing_reference, settings=settings
    )
    correct = _colour_correction(template, mesh, levels[-1], cameras, cosine) if settings.camera_gain else lambda level: level
    levels = [correct(level) for level in levels]
    rims = outline.outlines if masks is not None and settings.sigma_outline is not None else lambda stacked: None
    scene = Scene(mesh, cameras, reference.take(template, mesh, levels, cameras, cosine), settings, pixel_size(cameras, template))
    if start is None:
        state = State(0, template, template)
        now = Instant(tuple(levels), rims(first), _shape_at(mesh, template, prediction, 0, template, settings), _at(occluder, 0))
        yield _described(scene, now, _held(scene, now, template), 0), state
    else:
        state = start
    later = range(state.frame + 1, frames)

    def seen(t: int) -> tuple[tuple[Level, ...], outline.Outlines | None]:
        stacked = pyramid.stack(images, masks, t, cameras)
        return tuple(correct(pyramid.level(stacked, blur)) for blur in settings.blur_px), rims(stacked)

    for t, (levels, outlines) in zip(later, read_ahead(seen, later), strict=True):
        begin = _predicted(state, prediction, t)
        now = Instant(levels, outlines, _shape_at(mesh, template, prediction, t, begin, settings), _at(occluder, t))
        found = fit(scene, now, begin)
        state = State(t, state.last, found.x)
        yield _described(scene, now, found, t), state


def _shape_at(mesh: Surface, template: Array, prediction: Array | None, t: int, begin: Array, settings: Settings) -> Shape:
    return shape(mesh, template, None if prediction is None else prediction[t], begin, settings)


def _predicted(state: State, prediction: Array | None, t: int) -> Array:
    """Where to start looking in frame t [V, 3] m."""
    inertia = 2 * state.last - state.before
    if prediction is None:
        return inertia
    carried = state.last + (prediction[t] - prediction[t - 1])
    return np.where(np.isfinite(carried), carried, inertia)


def _held(scene: Scene, now: Instant, template: Array) -> Fit:
    """Frame 0: the template as it is."""
    view = look(scene, now, template)
    _, system = linearise(scene, now, len(now.levels) - 1, template, view)
    return Fit(template, view.weight, system, 0.0, "template")


def _described(scene: Scene, now: Instant, found: Fit, t: int) -> TrackedFrame:
    mesh = scene.surface
    r = photometric.residuals(
        found.x,
        mesh.faces,
        mesh.barycentric,
        level=now.levels[-1],
        cameras=scene.cameras,
        weight=found.weight,
        reference=scene.reference.colour[-1],
    )
    views = _views(mesh, found.weight, len(found.x))
    depth = depth_in_skin(found.x, mesh, scene.cameras.scaled(scene.settings.buffer_scale), views=views)
    σ = noise.stated(scene.settings.noise_calibration * noise.posterior(found.system), depth)
    rms = float(np.sqrt(np.nanmean(r[..., :3] ** 2))) if np.isfinite(r).any() else float("nan")
    return TrackedFrame(t, found.x, views.sum(1) >= _EYES, σ, rms, found.ending)


def _views(mesh: Surface, weight: NDArray[np.float32], vertex_count: int) -> NDArray[np.bool_]:
    """Which cameras see samples on the faces of a vertex [V, camera]."""
    by_face = (weight.reshape(len(mesh.faces), -1, weight.shape[1]) > 0).any(1)
    views = np.zeros((vertex_count, weight.shape[1]), bool)
    for corner in range(3):
        np.logical_or.at(views, mesh.faces[:, corner], by_face)
    return views


def _colour_correction(
    template: Array, mesh: Surface, level: Level, cameras: Cameras, cosine: NDArray[np.float32]
) -> Callable[[Level], Level]:
    gain, offset = reference.camera_gains(template, mesh, level, cameras, cosine)
    return lambda level: reference.corrected(level, gain, offset)


def _at(occluder: tuple[Array, NDArray[np.integer]] | None, t: int) -> Occluder | None:
    return None if occluder is None else Occluder(occluder[0][t], np.ascontiguousarray(occluder[1], dtype=np.int32))


def _collected(done: list[TrackedFrame], state: State | None) -> Tracked:
    return Tracked(
        done[0].frame if done else state.frame + 1,
        np.array([d.vertices for d in done]),
        np.array([d.seen for d in done]),
        np.array([d.noise_m for d in done]),
        np.array([d.photometric_rms for d in done]),
        tuple(d.ending for d in done),
        state,
    )


def _refuse_bad(template, faces, *, frames, part, prediction, occluder, start) -> None:
    faults = mesh_faults(np.asarray(template), np.asarray(faces), "template")
    V = len(template)
    if part.shape != (len(faces),):
        faults.append(Fault("part", f"shape {part.shape} for {len(faces)} faces", "Give one name per face."))
    if prediction is not None and (prediction.shape[1:] != (V, 3) or len(prediction) < frames):
        faults.append(Fault("prediction", f"shape {prediction.shape}", f"Expected [{frames}, {V}, 3]."))
    if occluder is not None and len(occluder[0]) < frames:
        faults.append(Fault("occluder", f"{len(occluder[0])} frames", f"Expected {frames}."))
    if start is not None and (start.last.shape != (V, 3) or start.before.shape != (V, 3)):
        faults.append(Fault("start", f"vertices {start.last.shape}", f"The state belongs to another template; expected [{V}, 3]."))
    if faults:
        raise BadInput(faults)
