"""The door of appearance: the garments' and the skin's texture from the pictures, in closed form."""

import numpy as np
from pydantic import Field

from storage_schemas.appearance import Appearance
from storage_schemas.capture import Capture
from storage_schemas.tracking import Tracking
from tasks.appearance.albedo import solve_albedo
from tasks.recorded import recorded
from tasks.stage import Job, Parameters, stage


class AppearanceParameters(Parameters):
    """frames: how many, spread over the sequence; held_out: index of the camera that only judges, in rigs of more than three."""

    frames: int = Field(default=6, ge=1)
    texture_size: int = Field(default=1024, ge=2)
    reduce: int = Field(default=1, ge=1)
    held_out: int = Field(default=2, ge=0)
    fit_gain: bool = True


@stage("appearance", version=2, pool="rendering", timeout_s=4 * 3600)
def appearance(job: Job, capture: Capture, tracking: Tracking, parameters: AppearanceParameters) -> Appearance:
    """Solve for the albedo; the mesh that blocks light is the tracked surface."""
    recording = recorded(capture, job.recording)
    count = len(tracking.vertices)
    frames = sorted(set(np.linspace(0, count - 1, parameters.frames).round().astype(int).tolist()))
    job.progress(0.05, f"{len(frames)} frames")
    found = solve_albedo(
        lambda frame, camera: recording.read_rgb(camera, frame),
        lambda frame, camera: recording.read_mask(camera, frame),
        recording.cameras,
        tracking.vertices.astype(float),
        tracking.faces,
        tracking.uv_vertices.astype(float),
        tracking.uv_faces,
        frames=frames,
        texture_size=(parameters.texture_size, parameters.texture_size),
        held_out=[parameters.held_out] if len(recording.cameras) > 3 else [],
        reduce=parameters.reduce,
        fit_gain=parameters.fit_gain,
    )
    job.progress(1.0, found.ending)
    if found.too_fine:
        job.warn(found.ending)
    return Appearance(
        albedo=found.albedo.astype(np.float32),
        observed=found.observed,
        light=np.asarray(found.light, np.float32),
        psnr=found.psnr.astype(np.float32),
        gains=found.gain.astype(np.float32),
        training_frames=tuple(frames),
    )
