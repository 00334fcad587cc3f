"""The door of gap: where the fitted physics differs from the recording, which effect it lacks, and how far the gap then shrinks.

Where is told of all garments; the cause is sought on the largest, whose motion says most. Effects that the fitted cloth already has are
part of the base, at the strengths fitted, and no suspects.
"""

import os
from dataclasses import replace
from typing import Any

import numpy as np

from storage_schemas.capture import Capture
from storage_schemas.cloth import Cloth
from storage_schemas.gap import NUMBERS, PAGE, Gap
from storage_schemas.registration import Registration
from storage_schemas.tracking import Tracking
from tasks.child_process import Pool
from tasks.cloth.contact_sagitta import contact_sagitta, drawn_in
from tasks.cloth.estimates import added_effects
from tasks.cloth.frame_rate import steps_per_frame
from tasks.cloth.garment import Garment, garments
from tasks.cloth.windows import Recording
from tasks.cloth.worn_scene import worn_scene
from tasks.effects.effect import Motion, Subject
from tasks.effects.library import library, suspects
from tasks.effects.model import Model
from tasks.gap.answer import answer
from tasks.gap.diagnosis import diagnose
from tasks.gap.residual import weft_direction, where
from tasks.gap.time_limit import time_limit
from tasks.gap.zones import ZONES, zones
from tasks.geometry.distances import closest_points
from tasks.report.gap_page import gap_report
from tasks.simulator import Fabric, Settings
from tasks.stage import Folder, Job, Parameters, Positive, stage


class GapParameters(Parameters):
    """density [kg/m³] of the cloth where it was weighed (ratios need none); quick: no second cause (`trials.py`);
    effects_folder: further effects, one Python file each, those of the cloth among them; limit_s: of simulating a second (`time_limit.py`)."""

    density: Positive = 320.0
    quick: bool = True
    effects_folder: Folder = None
    limit_s: Positive = 600.0


@stage("gap", version=16, pool="simulation", timeout_s=4 * 3600, spreads=True)
def gap(job: Job, capture: Capture, tracking: Tracking, body: Registration, cloth: Cloth, parameters: GapParameters) -> Gap:
    """Compare what was tracked with the replay of the fitted fabric, and look for the cause of the difference."""
    own, frames = cloth.vertices_index, slice(0, len(cloth.simulated))
    observed, simulated = tracking.vertices[frames][:, own].astype(float), cloth.simulated.astype(float)
    number = np.full(tracking.vertices.shape[1], -1)
    number[own] = np.arange(len(own))
    cut = (number[tracking.faces] >= 0).all(1) & (np.asarray(tracking.part_names)[tracking.part_of_face] != "body")
    faces, uv_faces = number[tracking.faces[cut]].astype(np.int32), tracking.uv_faces[cut]
    near = np.stack([closest_points(x, b.astype(float), body.faces).distance for x, b in zip(observed, body.vertices[frames])])
    zone = zones(faces, uv_faces if len(tracking.uv_vertices) else None, near, cloth.boundary)
    weft = weft_direction(simulated, faces, tracking.uv_vertices.astype(float), uv_faces) if len(tracking.uv_vertices) else None
    found = where(
        observed,
        simulated,
        seen=tracking.seen[frames][:, own],
        noise_m=tracking.noise_m[frames][:, own].astype(float),
        zone=zone,
        faces=faces,
        weft=weft,
        fps=capture.fps,
    )
    verdict, files = _diagnosed(job, capture, tracking, body, cloth, zone, parameters)
    return Gap(
        residual=found.residual.astype(np.float32),
        residual_mm=(1e3 * np.linalg.norm(found.residual, axis=-1)).astype(np.float32),
        zone_names=ZONES,
        zone_of_vertex=zone,
        tables={"zones": found.by_zone, "directions_mm": found.by_direction, "bands": found.by_band, "frame_mm": found.frame_mm.tolist()},
        floor_mm=found.floor_mm,
        verdict=verdict,
        files=files,
    )


def _diagnosed(
    job: Job, capture: Capture, tracking: Tracking, body: Registration, cloth: Cloth, zone: np.ndarray, parameters: GapParameters
) -> tuple[dict[str, Any], dict[str, bytes]]:
    """The answer on the largest garment, in the form that `physavatar gap run --json` prints, `garment` names it; and the files of what it
    rests on.
    """
    part = np.asarray(tracking.part_names)[tracking.part_of_face]
    worn = garments(tracking.vertices.astype(float), tracking.faces, tracking.uv_faces, part, tracking.seen, tracking.noise_m.astype(float))
    garment = max(worn, key=lambda g: len(g.index))
    model, recording = _subject(garment, capture, tracking, body, cloth, zone, parameters)
    doubt = contact_sagitta(model.subject.cloth, [recording], model.settings.barrier_distance)
    recording, given = drawn_in(recording, doubt), {e.name for e in model.effects}
    steps = iter(range(1, 1000))
    cores = os.cpu_count() or 1
    with Pool(limit_s=time_limit(parameters.limit_s, [recording], capture.fps), at_once=cores) as pool:
        found = diagnose(
            model,
            [recording],
            [e for e in suspects(library(parameters.effects_folder).values()) if e.name not in given],
            contact_doubt=doubt,
            quick=parameters.quick,
            run=job.spread(pool.map, cores),
            abreast=cores,
            tell=lambda text: job.progress(1 - 0.85 ** next(steps), text),
        )
    # the same input gives the same artifact; how long it took stands in the provenance
    told = {"garment": garment.name, **answer(found, seconds=None)}
    page, numbers = gap_report(told, found, [recording], title=f"{job.actor} · {job.sequence}: {garment.name}", subtitle="Gap diagnosis")
    return told, {PAGE: page, NUMBERS: numbers}


def _subject(
    garment: Garment, capture: Capture, tracking: Tracking, body: Registration, cloth: Cloth, zone: np.ndarray, parameters: GapParameters
):
    """The base model in the fabric that was fitted, and the recording of the garment."""
    settings = Settings(substeps=steps_per_frame(capture.fps), yield_collider=False)
    scene = worn_scene(
        garment, body.vertices.astype(float), body.faces, tracking.uv_vertices.astype(float), fps=capture.fps, settings=settings
    )
    fitted = cloth.parameters[garment.name]
    known = [fitted[k]["value"] for k in ("kappa_s_over_rho", "kappa_b_over_rho")]
    start = Fabric(parameters.density, 4.0 * parameters.density / 320, 60.0 * parameters.density / 320)
    fabric = replace(
        start,
        membrane=known[0] * parameters.density if known[0] else start.membrane,
        bending=known[1] * parameters.density if known[1] else start.bending,
    )
    own = np.isin(cloth.vertices_index, garment.index)
    place = {int(v): ZONES[z] for v, z in zip(cloth.vertices_index[own], zone[own])}
    names = np.array([place.get(int(v), "free") for v in garment.index])
    subject = Subject(scene.cloth, fabric, scene.collider, names, capture.fps)
    model = Model(subject, settings, *added_effects(fitted, library(parameters.effects_folder)))
    return model, Recording(scene.collider, Motion(scene.collider_motion, scene.boundary_motion), scene.observed, scene.noise_m)
