"""The door of cloth: cut out each garment, fit its fabric to the tracked motion, publish the fabric and how it then moves."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

import numpy as np

from storage_schemas.body import Body
from storage_schemas.capture import Capture
from storage_schemas.cloth import Cloth as ClothRecord
from storage_schemas.skinning import Skinning
from storage_schemas.tracking import Tracking
from tasks.child_process import run_in_children
from tasks.cloth.boundary import fastened_nodes
from tasks.cloth.collider import fitted_collider
from tasks.cloth.estimates import estimates
from tasks.cloth.garment import Garment, garments
from tasks.cloth.gauss_newton import Fit, Progress, fit
from tasks.cloth.rest_shape import pattern
from tasks.cloth.scene import Scene
from tasks.cloth.start import start_velocity
from tasks.geometry.faults import BadInput, Fault
from tasks.simulator import Cloth, Collider, Fabric, Settings
from tasks.skinning.linear_blend import repose
from tasks.stage import Job, Parameters, stage


class ClothParameters(Parameters):
    """Start values in the seed's units (ρ kg/m³, κ_s, κ_b), what drives the boundary nodes, the rest shape (`pattern` where
    the atlas is one, else as worn), and how the fit is computed."""

    density: float = 320.0
    membrane: float = 4.0
    bending: float = 60.0
    friction: float = 0.2
    boundary: Literal["tracked", "skinned"] = "tracked"
    rest: Literal["pattern", "worn"] = "pattern"
    iterations: int = 4
    substeps: int = 4
    frames: int = 24
    limit_s: float = 3600.0


@stage("cloth", version=1, pool="simulation", timeout_s=4 * 3600, retries=1)
def cloth(job: Job, capture: Capture, body: Body, tracking: Tracking, skinning: Skinning, parameters: ClothParameters) -> ClothRecord:
    """Fit all garments, two at a time, each in a child process that can be killed and goes on where it was."""
    worn = _garments(tracking)
    if not worn:
        raise BadInput(
            [Fault("template", "it has no part but 'body'", "Group the garments' faces by name (g skirt, g top …) in the template.")]
        )
    scenes = [_scene(garment, capture, body, tracking, skinning, parameters) for garment in worn]
    arguments = [(scene, parameters, str(job.checkpoint / f"{g.name}.json")) for g, scene in zip(worn, scenes)]
    told = [0.0] * len(worn)

    def on_message(index: int, message: dict[str, Any]) -> None:
        told[index] = message["fraction"]
        job.progress(float(np.mean(told)), f"{worn[index].name}: {message['rms_mm']:.1f} mm")

    fits = run_in_children(_fit, arguments, limit_s=parameters.limit_s, on_message=on_message)
    for garment, found in zip(worn, fits):
        if not found.replay.complete:
            job.warn(f"{garment.name}: {found.ending}")
    return _as_record(worn, scenes, fits)


def _garments(tracking: Tracking) -> list[Garment]:
    part = np.asarray(tracking.part_names)[tracking.part_of_face]
    vertices = tracking.vertices.astype(float)
    return garments(vertices, tracking.faces, tracking.uv_faces, part, tracking.seen, tracking.noise_m.astype(float))


def _scene(garment: Garment, capture: Capture, body: Body, tracking: Tracking, skinning: Skinning, parameters: ClothParameters) -> Scene:
    frames = slice(0, parameters.frames + 1)
    observed, person = garment.observed[frames], body.vertices[frames].astype(float)
    fastening = fastened_nodes(observed, garment.faces, person, body.faces)
    driven = observed[:, fastening.nodes]
    if parameters.boundary == "skinned":
        own = garment.index[fastening.nodes]
        driven = repose(
            skinning.rest_vertices[own].astype(float), skinning.weights[own].astype(float), body.transforms[frames].astype(float)
        )
    collider = fitted_collider(person, body.faces, observed, garment.faces, fastened=fastening.nodes)
    x0 = observed[0]
    uv = pattern(x0, garment.faces, tracking.uv_vertices.astype(float), garment.uv_faces) if parameters.rest == "pattern" else None
    return Scene(
        cloth=Cloth(x0, garment.faces, fastening.nodes, uv=uv, rest_angles="worn" if uv is None else "flat"),
        collider=Collider(collider.faces),
        collider_motion=collider.motion,
        boundary_motion=driven + (x0[fastening.nodes] - driven[0]),
        x0=x0,
        v0=start_velocity(observed, capture.fps),
        observed=np.where(garment.seen[frames, :, None], observed, np.nan),
        noise_m=garment.noise_m[frames],
        fps=capture.fps,
        settings=Settings(substeps=parameters.substeps),
    )


def _fit(scene: Scene, parameters: ClothParameters, checkpoint: str, tell: Any) -> Fit:
    """Runs in a child process; a killed fit goes on with the iteration it was in."""
    saved = Path(checkpoint)
    start = Progress(Fabric(parameters.density, parameters.membrane, parameters.bending, parameters.friction))
    if saved.exists():
        kept = json.loads(saved.read_text())
        start = Progress(Fabric(**kept["fabric"]), kept["damping"], tuple(kept["history"]))

    def on_iteration(progress: Progress) -> None:
        aside = saved.with_suffix(".tmp")
        aside.write_text(json.dumps({"fabric": asdict(progress.fabric), "damping": progress.damping, "history": progress.history}))
        aside.replace(saved)
        tell({"fraction": len(progress.history) / (parameters.iterations + 1), "rms_mm": progress.history[-1]["rms_mm"]})

    return fit(scene, start, iterations=parameters.iterations, on_iteration=on_iteration)


def _as_record(worn: list[Garment], scenes: list[Scene], fits: list[Fit]) -> ClothRecord:
    counts = [len(g.index) for g in worn]
    offset = np.concatenate([[0], np.cumsum(counts)[:-1]])
    frames = min(len(f.replay.x) for f in fits)
    boundary = [np.isin(np.arange(n), s.cloth.boundary) for n, s in zip(counts, scenes)]
    return ClothRecord(
        garment_names=tuple(g.name for g in worn),
        vertices_index=np.concatenate([g.index for g in worn]).astype(np.int32),
        garment_of_vertex=np.repeat(np.arange(len(worn)), counts).astype(np.int32),
        simulated=np.concatenate([f.replay.x[:frames] for f in fits], 1).astype(np.float32),
        faces=np.concatenate([g.faces + o for g, o in zip(worn, offset)]).astype(np.int32),
        boundary=np.concatenate(boundary),
        parameters={g.name: estimates(s, f) for g, s, f in zip(worn, scenes, fits)},
        loss_history={g.name: list(f.history) for g, f in zip(worn, fits)},
        timing={g.name: {"newton_iterations": f.replay.newton_iterations} for g, f in zip(worn, fits)},
        endings=tuple(f"{g.name}: {f.ending}" for g, f in zip(worn, fits)),
    )
