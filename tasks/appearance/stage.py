"""The door of appearance: the garments' and the skin's texture from the pictures, in closed form."""

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from storage_schemas.appearance import Appearance
from storage_schemas.capture import Capture
from storage_schemas.registration import Registration
from storage_schemas.skinning import Skinning
from storage_schemas.tracking import Tracking
from tasks.appearance.albedo import solve_albedo
from tasks.geometry.cameras import Cameras
from tasks.geometry.parts import skin_vertices
from tasks.recorded import recorded
from tasks.skinning.linear_blend import repose
from tasks.stage import Job, Parameters, stage


class AppearanceParameters(Parameters):
    """frames: how many, spread over the sequence; held_out: index of the camera that only judges, in rigs of more than three."""

    frames: int = Field(default=6, ge=1)
    texture_size: int = Field(default=1024, ge=2)
    reduce: int = Field(default=1, ge=1)
    held_out: int = Field(default=2, ge=0)
    fit_gain: bool = True

    def judges(self, cameras: Cameras) -> list[int]:
        """The cameras of a rig that do not enter the fit."""
        return [self.held_out] if len(cameras) > 3 else []


@stage("appearance", version=3, pool="rendering", timeout_s=4 * 3600)
def appearance(
    job: Job, capture: Capture, tracking: Tracking, body: Registration, skinning: Skinning, parameters: AppearanceParameters
) -> Appearance:
    """Solve for the albedo; the mesh that blocks light is the tracked garments and the skin that the registered body carries."""
    recording = recorded(capture, job.recording)
    count = len(tracking.vertices)
    frames = sorted(set(np.linspace(0, count - 1, parameters.frames).round().astype(int).tolist()))
    job.progress(0.05, f"{len(frames)} frames")
    found = solve_albedo(
        lambda frame, camera: recording.read_rgb(camera, frame),
        lambda frame, camera: recording.read_mask(camera, frame),
        recording.cameras,
        _surface(tracking, body, skinning),
        tracking.faces,
        tracking.uv_vertices.astype(float),
        tracking.uv_faces,
        frames=frames,
        texture_size=(parameters.texture_size, parameters.texture_size),
        held_out=parameters.judges(recording.cameras),
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


def _surface(tracking: Tracking, body: Registration, skinning: Skinning) -> NDArray[np.float64]:
    """The tracked surface [frame, V, 3] m with its skin as the avatar wears it: as tracked, hidden skin shows through garments. A surface of
    one piece stays as it is, for nobody knows what of it is skin.
    """
    x, part = tracking.vertices.astype(float), np.asarray(tracking.part_names)[tracking.part_of_face]
    skin = skin_vertices(tracking.faces, part, x.shape[1])
    if not skin.all():
        x[:, skin] = repose(skinning.rest_vertices[skin].astype(float), skinning.weights[skin].astype(float), body.transforms.astype(float))
    return x
