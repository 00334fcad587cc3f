"""The door of tracking: follow the surface of the first frame through all pictures, resumable after every frame."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import Field

from storage_schemas.body import Body
from storage_schemas.capture import Capture
from storage_schemas.tracking import Tracking
from tasks.capture.template import Template, read_template
from tasks.geometry.parts import SKIN, skin_vertices
from tasks.geometry.unwrap import unwrap
from tasks.recorded import recorded
from tasks.stage import Job, Parameters, stage
from tasks.tracking.body_motion import carried_by_body
from tasks.tracking.sequence import State, TrackedFrame, track_sequence
from tasks.tracking.settings import Settings

NO_PATTERN = (
    "The garments came without texture coordinates, and the atlas made for them follows their folds: it is no sewing pattern. "
    "Set cloth.rest=worn, and believe nothing that is said of seams, weft and warp."
)


class TrackingParameters(Parameters):
    """template: the surface at the first frame; by default the recording's own, else a visual hull with this many vertices."""

    hull_vertices: int = Field(default=4000, ge=4)
    camera_gain: bool = True


@stage("tracking", version=6, pool="tracking", timeout_s=24 * 3600, retries=1)
def tracking(job: Job, capture: Capture, body: Body, parameters: TrackingParameters) -> Tracking:
    """Track skin and garments; skin starts each frame where the fitted body carries it."""
    recording = recorded(capture, job.recording)
    template = _with_atlas(read_template(recording.template) if recording.template else _hull(recording, parameters), job.warn)
    skin = skin_vertices(template.faces, template.part, len(template.vertices))
    done: list[TrackedFrame] = []
    start = _resume(job.checkpoint, done)
    count = len(recording.frames)

    def on_frame(found: TrackedFrame, state: State) -> None:
        done.append(found)
        _keep(job.checkpoint, found, state)
        job.progress((found.frame + 1) / count, f"frame {found.frame + 1} of {count}")

    track_sequence(
        lambda frame, camera: recording.read_rgb(camera, frame),
        None if recording.mask is None else lambda frame, camera: recording.read_mask(camera, frame),
        recording.cameras,
        template.vertices,
        template.faces,
        frames=count,
        part=template.part,
        prediction=carried_by_body(template.vertices, skin, body.vertices.astype(float), body.faces),
        settings=replace(Settings(), camera_gain=parameters.camera_gain),
        start=start,
        on_frame=on_frame,
    )
    names, part = np.unique(template.part, return_inverse=True)
    return Tracking(
        vertices=np.stack([f.vertices for f in done]).astype(np.float32),
        faces=template.faces,
        uv_vertices=template.uv_vertices.astype(np.float32),
        uv_faces=template.uv_faces,
        part_names=tuple(names.tolist()),
        part_of_face=part.astype(np.int32),
        seen=np.stack([f.seen for f in done]),
        noise_m=np.stack([f.noise_m for f in done]).astype(np.float32),
        photometric_rms=np.array([f.photometric_rms for f in done], np.float32),
        endings=tuple(f.ending for f in done),
    )


def _hull(recording, parameters: TrackingParameters) -> Template:
    from tasks.tracking.visual_hull import visual_hull

    masks = [recording.read_mask(camera, 0) for camera in range(len(recording.cameras))]
    vertices, faces = visual_hull(masks, recording.cameras, target_vertices=parameters.hull_vertices)
    return Template(vertices, faces, np.zeros((0, 2)), np.zeros((0, 3), np.int32), np.full(len(faces), SKIN))


def _with_atlas(template: Template, warn: Callable[[str], None]) -> Template:
    """Texture coordinates of its own for a surface that came without: what is tracked is also painted."""
    if len(template.uv_vertices):
        return template
    if (template.part != SKIN).any():
        warn(NO_PATTERN)
    uv_vertices, uv_faces = unwrap(template.vertices, template.faces)
    return replace(template, uv_vertices=uv_vertices, uv_faces=uv_faces)


def _keep(folder: Path, found: TrackedFrame, state: State) -> None:
    aside = folder / f".{found.frame:06d}.npz"
    np.savez(
        aside,
        **{k: v for k, v in vars(found).items() if k != "ending"},
        ending=np.array(found.ending),
        before=state.before,
        last=state.last,
    )
    aside.replace(folder / f"frame{found.frame:06d}.npz")


def _resume(folder: Path, done: list[TrackedFrame]) -> State | None:
    state = None
    for t, file in enumerate(sorted(folder.glob("frame*.npz"))):
        with np.load(file, allow_pickle=False) as kept:
            rms, ending = float(kept["photometric_rms"]), str(kept["ending"])
            done.append(TrackedFrame(t, kept["vertices"], kept["seen"], kept["noise_m"], rms, ending))
            state = State(t, kept["before"], kept["last"])
    return state
