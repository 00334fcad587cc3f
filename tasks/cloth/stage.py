"""The doors of cloth: garments of a recorded actor, or of anybody's tracked geometry. Fit each fabric, publish it and how it then moves."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import count
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator

from storage_schemas.capture import Capture
from storage_schemas.cloth import Cloth as ClothRecord
from storage_schemas.registration import Registration
from storage_schemas.skinning import Skinning
from storage_schemas.tracking import Tracking
from tasks.capture.tracked_geometry import read_tracked_geometry
from tasks.child_process import Pool
from tasks.cloth.adam_fd import FRAMES, ITERATIONS, Descent, as_algorithm_1, at_ends, descend, found_fabric
from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.checkpoints import FrameFile, load_descent, load_progress, save_descent, save_progress
from tasks.cloth.estimates import estimates
from tasks.cloth.frame_rate import FEWEST, frames_compared, steps_per_frame
from tasks.cloth.garment import Garment, garments, weighed
from tasks.cloth.gauss_newton import Fit, Progress, fit, horizons, normal_equations
from tasks.cloth.knowledge import knowledge
from tasks.cloth.perseverance import Patience
from tasks.cloth.scene import Scene, replay
from tasks.cloth.shooting import Map
from tasks.cloth.tracked_scene import tracked_scene
from tasks.cloth.windowed_fit import Windowed, fit_windows, started_well
from tasks.cloth.worn_scene import worn_scene
from tasks.effects.effect import Effect
from tasks.effects.library import library, suspects
from tasks.effects.named import named
from tasks.geometry.faults import BadInput, Fault
from tasks.simulator import Fabric, Settings
from tasks.skinning.linear_blend import repose
from tasks.stage import Count, Folder, Job, NotNegative, Parameters, Positive, stage

GAUSS_NEWTON_ITERATIONS = 4
AT_ONCE = 2  # computations side by side on one machine


class FitParameters(Parameters):
    """How a fabric is fitted: on windows, on one replay of the whole, or by Algorithm 1. Start values in the seed's units (ρ kg/m³, κ_s,
    κ_b); `iterations` None: 4 by tangents, 100 by differences.

    effects: names of effects that the model has beside the base, of the library or of effects_folder; their strengths are fitted too.
    frames: how many after the first are compared; None: about a second of them, 24 in Algorithm 1. substeps: time steps of a frame; None: as
    few as take no longer than 10 ms each (`frame_rate.py`).
    attempts: how often a simulation, or a process that was killed or passed limit_s, may be begun; frame_s: processor time of one frame.
    """

    method: Literal["gauss-newton", "whole-replay", "adam-fd"] = "gauss-newton"
    as_released: bool = False
    density: Positive = 320.0
    membrane: Positive = 4.0
    bending: Positive = 60.0
    friction: NotNegative = 0.2
    boundary: Literal["tracked", "skinned"] = "tracked"
    iterations: Count | None = None
    substeps: Count | None = None
    frames: Annotated[int, Field(ge=FEWEST)] | None = None
    profiles: bool = False
    attempts: Count = 3
    frame_s: Positive = 600.0
    limit_s: Positive = 3600.0
    effects_folder: Folder = None
    effects: tuple[str, ...] = ()

    @field_validator("effects", mode="before")
    @classmethod
    def _one_name_is_a_list(cls, given: Any) -> Any:
        return given.split(",") if isinstance(given, str) else given

    @field_validator("effects")
    @classmethod
    def _known(cls, names: tuple[str, ...], info: ValidationInfo) -> tuple[str, ...]:
        if names and (info.data.get("method") != "gauss-newton" or info.data.get("profiles")):
            raise ValueError("effects are fitted by gauss-newton, and profiles are drawn of the base model: leave out one of the two")
        return tuple(e.name for e in _effects(names, info.data.get("effects_folder"))) if names else ()

    @property
    def fabric(self) -> Fabric:
        """Where the search starts; Algorithm 1 has a start of its own within its ranges."""
        if self.method == "adam-fd":
            return Fabric(self.density, 1.0, 1.0, self.friction)
        return Fabric(self.density, self.membrane, self.bending, self.friction)

    def settings(self, fps: float) -> Settings:
        """How a recording of that many frames per second is simulated."""
        return Settings(substeps=self.substeps or steps_per_frame(fps))

    def compared(self, fps: float) -> int:
        """How many frames after the first of such a recording are compared."""
        return self.frames or (FRAMES if self.method == "adam-fd" else frames_compared(fps))


class ClothParameters(FitParameters):
    """Also: the rest shape, `pattern` where the atlas is one, else as worn."""

    rest: Literal["pattern", "worn"] = "pattern"


class TrackParameters(FitParameters):
    """Also: the file or folder of tracked geometry; fps and up instead of what it says; at_rest: the garment is still in its first frame."""

    track: Folder = None
    fps: Positive | None = None
    up: Literal["y", "z"] | None = None
    at_rest: bool = False


def _effects(names: tuple[str, ...], folder: Folder) -> tuple[Effect, ...]:
    known = library(folder)
    return named(names, {e.name: e for e in suspects(known.values())}, "effects")


@dataclass(frozen=True)
class Work:
    """One garment to fit; `otherwise` [T, B, 3] m is its boundary driven the other way, `weighed`: its density is known."""

    name: str
    scene: Scene
    fabric: Fabric
    otherwise: NDArray[np.float64] | None = None
    weighed: bool = False


@stage("cloth", version=7, pool="simulation", timeout_s=4 * 3600, retries=1, spreads=True)
def cloth(
    job: Job, capture: Capture, body: Registration, tracking: Tracking, skinning: Skinning, parameters: ClothParameters
) -> ClothRecord:
    """Fit all garments of an actor, one after the other, each on both cores. Where they were weighed, together, they are taken to be of one density."""
    worn = _garments(tracking)
    if not worn:
        raise BadInput(
            [Fault("template", "it has no part but 'body'", "Group the garments' faces by name (g skirt, g top …) in the template.")]
        )
    scenes = [_scene(g, capture, body, tracking, skinning, parameters) for g in worn]
    fabric = weighed(parameters.fabric, [s.cloth for s in scenes], capture.mass_kg)
    work = [Work(g.name, s, fabric, weighed=capture.mass_kg is not None) for g, s in zip(worn, scenes, strict=True)]
    return _as_record(work, _fits(job, work, parameters), index=[g.index for g in worn])


@stage("cloth", version=7, pool="simulation", timeout_s=4 * 3600, retries=1)
def track_fit(job: Job, parameters: TrackParameters) -> ClothRecord:
    """Fit one garment of which somebody else's tracker tells the motion; needs no other stage."""
    path = parameters.track
    track = read_tracked_geometry(path, fps=parameters.fps, up=parameters.up)
    found = tracked_scene(
        track,
        name=str(path),
        driver=parameters.boundary,
        frames=parameters.compared(track.fps),
        at_rest=parameters.at_rest,
        fabric=parameters.fabric,
        settings=parameters.settings(track.fps),
        patience=Patience(parameters.attempts, parameters.frame_s),
    )
    for said in (*track.warnings, *found.chosen):
        job.warn(said)
    work = Work("garment", found.scene, found.fabric, found.otherwise, found.weighed)
    return _as_record([work], _fits(job, [work], parameters), index=[np.arange(len(found.scene.x0), dtype=np.int32)], said=found.chosen)


def _garments(tracking: Tracking) -> list[Garment]:
    part = np.asarray(tracking.part_names)[tracking.part_of_face]
    vertices = tracking.vertices.astype(float)
    return garments(vertices, tracking.faces, tracking.uv_faces, part, tracking.seen, tracking.noise_m.astype(float))


def _scene(
    garment: Garment, capture: Capture, body: Registration, tracking: Tracking, skinning: Skinning, parameters: ClothParameters
) -> Scene:
    frames = slice(0, parameters.compared(capture.fps) + 1)
    scene = worn_scene(
        replace(garment, observed=garment.observed[frames], seen=garment.seen[frames], noise_m=garment.noise_m[frames]),
        body.vertices[frames].astype(float),
        body.faces,
        tracking.uv_vertices.astype(float),
        fps=capture.fps,
        rest=parameters.rest,
        settings=parameters.settings(capture.fps),
        patience=Patience(parameters.attempts, parameters.frame_s),
    )
    if parameters.boundary == "tracked":
        return scene
    own = garment.index[scene.cloth.boundary]
    carried = repose(skinning.rest_vertices[own].astype(float), skinning.weights[own].astype(float), body.transforms[frames].astype(float))
    return replace(scene, boundary_motion=carried + (scene.x0[scene.cloth.boundary] - carried[0]))


Fitted = tuple[Scene, Fit, dict[str, Any]]


def _fits(job: Job, work: list[Work], parameters: FitParameters) -> list[Fitted]:
    """(the scene that was simulated, the fit, what can be known of it) of every garment; warns of everything that had to be retried.

    Windows, or the four simulations of Algorithm 1, are mapped over two processes and those of helpers; one that is killed or slow is begun
    again.
    """
    fitted = []
    for each in work:
        with Pool(limit_s=parameters.limit_s, at_once=AT_ONCE, attempts=parameters.attempts) as pool:
            scene, found, known = BY[parameters.method](job, each, parameters, job.spread(pool.map, AT_ONCE))
            found = replace(found, reasons=(*pool.reasons, *found.reasons))
        for said in (*found.reasons, *([] if found.replay.complete else [f"replay of the whole: {found.replay.ending}"])):
            job.warn(f"{each.name}: {said}")
        fitted.append((scene, found, known))
    return fitted


def _by_tangents(job: Job, work: Work, parameters: FitParameters, run: Map) -> Fitted:
    """Gauss–Newton on windows; those that an interrupted run has finished are not followed again."""
    scene, memory = started_well(work.scene, work.fabric), FrameFile(job.checkpoint / work.name)
    effects = _effects(parameters.effects, parameters.effects_folder)
    iterations, rounds = parameters.iterations or GAUSS_NEWTON_ITERATIONS, count(1)

    def tell(text: str) -> None:
        job.progress(1 - 0.9 ** next(rounds), f"{work.name}: {text}")  # nobody knows how many rounds there will be

    found = fit_windows(scene, work.fabric, effects=effects, iterations=iterations, run=run, memory=memory, tell=tell)
    known = knowledge(scene, found, objective=Windowed.of(found, run), otherwise=work.otherwise, profiles=parameters.profiles)
    return scene, found, known


def _by_whole_replay(job: Job, work: Work, parameters: FitParameters, run: Map) -> Fitted:
    """Gauss–Newton on one replay from the first frame to the last: what Algorithm 1 minimises too. An interrupted run is gone on with."""
    scene, memory = started_well(work.scene, work.fabric), FrameFile(job.checkpoint / work.name)
    saved = job.checkpoint / f"{work.name}.json"
    iterations = parameters.iterations or GAUSS_NEWTON_ITERATIONS
    most = len(horizons(len(scene.observed), scene.fps)) * (iterations + 1)

    def on_iteration(now: Progress) -> None:
        save_progress(saved, now)
        job.progress(len(now.history) / most, f"{work.name}: {now.history[-1]['rms_mm']:.1f} mm")

    start = load_progress(saved, Progress(work.fabric))
    found = fit(scene, start, iterations=iterations, on_iteration=on_iteration, memory=memory)
    return scene, found, knowledge(scene, found, otherwise=work.otherwise, profiles=parameters.profiles)


def _by_differences(job: Job, work: Work, parameters: FitParameters, run: Map) -> Fitted:
    """Algorithm 1."""
    scene, saved = as_algorithm_1(work.scene), job.checkpoint / f"{work.name}.json"
    iterations = parameters.iterations or ITERATIONS

    def on_iteration(descent: Descent) -> None:
        save_descent(saved, descent)
        job.progress(len(descent.history) / iterations, f"{work.name}: {descent.history[-1]['rms_mm']:.1f} mm")

    start = load_descent(saved, Descent.at([work.fabric.density, work.fabric.membrane, work.fabric.bending]))
    descent = descend(
        scene, work.fabric, start, iterations=iterations, as_released=parameters.as_released, run=run, on_iteration=on_iteration
    )
    fabric = found_fabric(work.fabric, descent, density=work.fabric.density if work.weighed else None)
    last = replay(scene, fabric, tangents=PARAMETERS)
    reasons = (*descent.reasons, *last.reasons)
    found = Fit(fabric, normal_equations(scene, last), last, descent.history, descent.ending, reasons, at_ends=at_ends(descent))
    return scene, found, knowledge(scene, found, profiles=parameters.profiles)


BY = {"gauss-newton": _by_tangents, "whole-replay": _by_whole_replay, "adam-fd": _by_differences}


def _untimed(row: Mapping[str, Any]) -> dict[str, Any]:
    """Without how long it took: the same input gives the same artifact, and what comes after knows an artifact by its content."""
    return {name: value for name, value in row.items() if name != "seconds"}


def _as_record(work: list[Work], fitted: list[Fitted], *, index: list[np.ndarray], said: tuple[str, ...] = ()) -> ClothRecord:
    counts = [len(i) for i in index]
    offset = np.concatenate([[0], np.cumsum(counts)[:-1]])
    fits = [found for _, found, _ in fitted]
    frames = min(len(f.replay.x) for f in fits)
    boundary = [np.isin(np.arange(n), scene.cloth.boundary) for n, (scene, _, _) in zip(counts, fitted)]
    faces = [scene.cloth.faces + o for (scene, _, _), o in zip(fitted, offset)]
    return ClothRecord(
        garment_names=tuple(w.name for w in work),
        vertices_index=np.concatenate(index).astype(np.int32),
        garment_of_vertex=np.repeat(np.arange(len(work)), counts).astype(np.int32),
        simulated=np.concatenate([f.replay.x[:frames] for f in fits], 1).astype(np.float32),
        faces=np.concatenate(faces).astype(np.int32),
        boundary=np.concatenate(boundary),
        parameters={w.name: estimates(scene, found, weighed=w.weighed) for w, (scene, found, _) in zip(work, fitted)},
        loss_history={w.name: [_untimed(row) for row in f.history] for w, f in zip(work, fits)},
        timing={w.name: {"newton_iterations": f.replay.newton_iterations} for w, f in zip(work, fits)},
        endings=(*said, *(f"{w.name}: {line}" for w, f in zip(work, fits) for line in (f.ending, *f.reasons))),
        knowledge={w.name: known for w, (_, _, known) in zip(work, fitted)},
    )
