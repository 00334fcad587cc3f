"""The door of the report: one page per sequence from everything the stages found."""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field

from storage_schemas.appearance import Appearance
from storage_schemas.body import Body
from storage_schemas.capture import Capture
from storage_schemas.cloth import Cloth
from storage_schemas.gap import NUMBERS, PAGE, Gap
from storage_schemas.keypoints import Keypoints
from storage_schemas.registration import Registration
from storage_schemas.report import Report
from storage_schemas.skinning import Skinning
from storage_schemas.tracking import Tracking
from tasks.appearance.colour import srgb8_from_linear
from tasks.body.wholebody import LIMBS, NAMES
from tasks.geometry.cameras import Cameras
from tasks.recorded import recorded
from tasks.report import sections
from tasks.report.page import Section, page
from tasks.stage import Job, Parameters, stage

VIEWS = 4  # cameras shown
EVIDENCE = {PAGE: "What that rests on, figure by figure", NUMBERS: "The same in numbers"}


class ReportParameters(Parameters):
    """scores: figures against a truth, from a scorer outside the stages; stages: seconds, keys and warnings, for the last section."""

    scores: dict[str, Any] | None = None
    stages: dict[str, dict[str, Any]] = Field(default_factory=dict)


@stage("report", version=4, pool="rendering", timeout_s=1800)
def report(
    job: Job,
    capture: Capture,
    parameters: ReportParameters,
    keypoints: Keypoints | None = None,
    body: Body | None = None,
    tracking: Tracking | None = None,
    registration: Registration | None = None,
    skinning: Skinning | None = None,
    cloth: Cloth | None = None,
    appearance: Appearance | None = None,
    gap: Gap | None = None,
) -> Report:
    """A page on whatever stages were reached, drawn at the last frame they share, from cameras spread over the rig."""
    view = _View.of(capture, job, len(cloth.simulated) - 1 if cloth else len(capture.frame_numbers) - 1)
    found = [
        *([sections.truth_section(parameters.scores)] if parameters.scores else []),
        *([_cause(gap), _gap(view, cloth, gap, capture.fps)] if gap else []),
        *([sections.cloth_section(cloth.parameters, cloth.loss_history, cloth.endings)] if cloth else []),
        *([_tracking(view, tracking)] if tracking else []),
        *([_body(view, registration or body, capture)] if body else []),
        *([_keypoints(view, keypoints, body)] if keypoints else []),
        *([_appearance(appearance, capture)] if appearance else []),
        sections.provenance_section(parameters.stages, _warnings(capture, parameters.stages)),
    ]
    subtitle = f"{len(capture.camera_names)} cameras, {len(capture.frame_numbers)} frames at {capture.fps:g} frames/s"
    verdict = gap.verdict["verdict"]["sentence"] if gap else "The cloth of this recording was not simulated: no gap to report."
    html = page(f"{job.actor} · {job.sequence}", subtitle, verdict, found)
    summary = {
        "verdict": gap.verdict if gap else None,
        "fabric": cloth.parameters if cloth else None,
        "scores": parameters.scores,
        "endings": cloth.endings if cloth else [],
    }
    files = {"report.html": html.encode(), "summary.json": json.dumps(summary, indent=1).encode()}
    return Report(files=files | (gap.files if gap else {}), summary=summary)


@dataclass(frozen=True)
class _View:
    """What the pictures show: frame t in some cameras."""

    t: int
    shown: np.ndarray
    rig: Cameras
    images: list[np.ndarray]

    @classmethod
    def of(cls, capture: Capture, job: Job, t: int) -> "_View":
        recording = recorded(capture, job.recording)
        shown = np.unique(np.linspace(0, len(recording.cameras) - 1, VIEWS).round().astype(int))
        return cls(t, shown, recording.cameras.subset(shown), [recording.read_rgb(int(camera), t) for camera in shown])


def _warnings(capture: Capture, stages: dict[str, dict[str, Any]]) -> list[str]:
    """Of the recording, then of the stages by their name."""
    told = {name: s.get("warnings", []) for name, s in stages.items() if name != "capture"}
    return [*capture.warnings, *(f"{name}: {said}" for name, warnings in told.items() for said in warnings)]


def _cause(gap: Gap) -> Section:
    return sections.cause_section(gap.verdict, [(words, name) for name, words in EVIDENCE.items() if name in gap.files])


def _gap(view: _View, cloth: Cloth, gap: Gap, fps: float) -> Section:
    x = cloth.simulated[view.t].astype(float)
    return sections.gap_section(view.images[0], view.rig, 0, x, cloth.faces, gap.residual_mm.astype(float), gap.tables, fps)


def _tracking(view: _View, tracking: Tracking) -> Section:
    part = np.asarray(tracking.part_names)[tracking.part_of_face]
    return sections.tracking_section(
        view.images, view.rig, view.t, tracking.vertices, tracking.faces, part, tracking.photometric_rms, tracking.seen, tracking.noise_m
    )


def _body(view: _View, body: Body, capture: Capture) -> Section:
    x = body.vertices[view.t].astype(float)
    return sections.body_section(view.images, view.rig, x, body.faces, body.reprojection_px, capture.camera_names, NAMES, body.ending)


def _keypoints(view: _View, keypoints: Keypoints, body: Body | None) -> Section:
    uv, score = keypoints.keypoints[view.t, view.shown], keypoints.score[view.t, view.shown]
    person = None if body is None else body.vertices[view.t].astype(float)
    return sections.keypoint_section(view.images, uv, score, LIMBS, person, view.rig, keypoints.detector)


def _appearance(appearance: Appearance, capture: Capture) -> Section:
    texture = srgb8_from_linear(appearance.albedo)
    return sections.appearance_section(texture, appearance.psnr, appearance.training_frames, capture.camera_names)
