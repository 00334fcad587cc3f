"""The door of the report: one page per sequence from everything the stages found."""

import json
from typing import Any

import numpy as np

from storage_schemas.appearance import Appearance
from storage_schemas.body import Body
from storage_schemas.capture import Capture
from storage_schemas.cloth import Cloth
from storage_schemas.gap import Gap
from storage_schemas.keypoints import Keypoints
from storage_schemas.report import Report
from storage_schemas.skinning import Skinning
from storage_schemas.tracking import Tracking
from tasks.appearance.colour import srgb8_from_linear
from tasks.body.wholebody import LIMBS
from tasks.recorded import recorded
from tasks.report import sections
from tasks.report.page import page
from tasks.stage import Job, Parameters, stage

VIEWS = 4  # cameras shown


class ReportParameters(Parameters):
    """scores: figures against a truth, from a scorer outside the stages; stages: seconds and keys, for the last section."""

    scores: dict[str, Any] | None = None
    stages: dict[str, dict[str, Any]] = {}


@stage("report", version=1, pool="rendering", timeout_s=1800)
def report(
    job: Job,
    capture: Capture,
    keypoints: Keypoints,
    body: Body,
    tracking: Tracking,
    skinning: Skinning,
    cloth: Cloth,
    appearance: Appearance,
    gap: Gap,
    parameters: ReportParameters,
) -> Report:
    """Draw the last frame of the fit, from cameras spread over the rig."""
    recording = recorded(capture, job.recording)
    shown = np.unique(np.linspace(0, len(recording.cameras) - 1, VIEWS).round().astype(int))
    t = len(cloth.simulated) - 1
    rig = recording.cameras.subset(shown)
    images = [recording.read_rgb(camera, t) for camera in shown]
    part = np.asarray(tracking.part_names)[tracking.part_of_face]
    found = [
        *([sections.truth_section(parameters.scores)] if parameters.scores else []),
        sections.gap_section(
            images[0], rig, 0, cloth.simulated[t].astype(float), cloth.faces, _rms(gap.residual_mm), gap.tables, capture.fps
        ),
        sections.cloth_section(cloth.parameters, cloth.loss_history, cloth.endings),
        sections.tracking_section(
            images, rig, tracking.vertices[t].astype(float), tracking.faces, part, tracking.photometric_rms, tracking.seen, tracking.noise_m
        ),
        sections.body_section(
            images, rig, body.vertices[t].astype(float), body.faces, body.reprojection_px, keypoints.camera_names, body.ending
        ),
        sections.keypoint_section(
            images, keypoints.keypoints[t, shown], keypoints.score[t, shown], LIMBS, body.vertices[t].astype(float), rig, keypoints.detector
        ),
        sections.appearance_section(srgb8_from_linear(appearance.albedo), appearance.psnr, appearance.training_frames, capture.camera_names),
        sections.provenance_section(parameters.stages, capture.warnings),
    ]
    title = f"{job.actor} · {job.sequence}"
    subtitle = f"{len(capture.camera_names)} cameras, {len(capture.frame_numbers)} frames at {capture.fps:g} frames/s"
    verdict = gap.verdict["verdict"]["sentence"]
    html = page(title, subtitle, verdict, found)
    summary = {"verdict": gap.verdict, "fabric": cloth.parameters, "scores": parameters.scores, "endings": cloth.endings}
    return Report(files={"report.html": html.encode(), "summary.json": json.dumps(summary, indent=1).encode()}, summary=summary)


def _rms(residual_mm: np.ndarray) -> np.ndarray:
    squared = np.where(np.isfinite(residual_mm), residual_mm, 0.0) ** 2
    return np.sqrt(squared.sum(0) / np.maximum(np.isfinite(residual_mm).sum(0), 1))
