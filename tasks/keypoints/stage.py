"""The door of keypoints: find the 133 points of COCO-WholeBody in every picture."""

from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from storage_schemas.capture import Capture
from storage_schemas.keypoints import Keypoints
from tasks.capture.recording import Recording
from tasks.geometry.faults import BadInput, Fault
from tasks.keypoints.detector import BUNDLED, Detector
from tasks.keypoints.keypoint_files import read_keypoints
from tasks.keypoints.person_box import moving_person, temporal_median
from tasks.keypoints.rig_keypoints import RigKeypoints, follow_masks, follow_motion
from tasks.keypoints.sides import same_sides
from tasks.recorded import recorded
from tasks.stage import Folder, Job, ModelFile, Parameters, content_digest, stage

GLIMPSES = 12  # pictures per camera from which the moving person is told from the background


class KeypointsParameters(Parameters):
    """model: a DWPose, RTMW or RTMPose ONNX file; by default the bundled detector, trained on synthetic people. file: keypoints found
    elsewhere; pixel_centre: what that file calls the centre of the first pixel [px], 0 as DWPose and OpenPose do, or 0.5.
    """

    model: Annotated[ModelFile, AfterValidator(lambda model: model or BUNDLED)] = BUNDLED
    file: Folder = None
    pixel_centre: float = Field(0.0, ge=0, le=0.5)


@stage("keypoints", version=3, pool="vision", timeout_s=4 * 3600)
def keypoints(job: Job, capture: Capture, parameters: KeypointsParameters) -> Keypoints:
    """Detect in all frames and cameras, or read what was detected elsewhere."""
    recording = recorded(capture, job.recording)
    if parameters.file is not None:
        return _read(parameters.file, recording, parameters.pixel_centre)
    model = parameters.model
    found, turned = same_sides(recording.cameras, _follow(Detector.load(model), recording, job))
    if turned.any():
        job.warn(f"{turned.sum()} of {turned.size} views had left and right swapped, as the other cameras see it; they were turned round")
    return Keypoints(
        keypoints=found.uv.astype(np.float32),
        score=found.score.astype(np.float32),
        boxes=found.box.astype(np.float32),
        camera_names=recording.cameras.names,
        detector=model.name,
        detector_sha256=content_digest(model),
    )


def _follow(detector: Detector, recording: Recording, job: Job) -> RigKeypoints:
    cameras, count = range(len(recording.cameras)), len(recording.frames)

    def pictures(frame: int) -> list[np.ndarray]:
        job.progress((frame + 1) / count, f"frame {frame + 1} of {count}")
        return [recording.read_rgb(camera, frame) for camera in cameras]

    if recording.mask is not None:
        return follow_masks(detector, ((pictures(t), [recording.read_mask(camera, t) for camera in cameras]) for t in range(count)))
    spread = np.unique(np.linspace(0, count - 1, GLIMPSES).astype(int)).tolist()
    still = [temporal_median([recording.read_rgb(camera, t) for t in spread]) for camera in cameras]
    seek = partial(moving_person, recording.cameras, still)
    found = follow_motion(detector, recording.cameras, (pictures(t) for t in range(count)), seek)
    if not np.isfinite(found.box).any():
        remedy = "Store masks beside the pictures, or give keypoints found elsewhere by keypoints.file."
        raise BadInput([Fault(str(recording.root), "in no frame does anybody move where two cameras agree on it", remedy)])
    return found


def _read(path: Path, recording: Recording, pixel_centre: float) -> Keypoints:
    uv, score = read_keypoints(path, recording.cameras.names, frames=len(recording.frames), pixel_centre=pixel_centre)
    return Keypoints(
        keypoints=uv.astype(np.float32),
        score=score.astype(np.float32),
        boxes=np.full((*score.shape[:2], 4), np.nan, np.float32),
        camera_names=recording.cameras.names,
        detector=path.name,
        detector_sha256=content_digest(path),
    )
