"""Everything that can be found wrong before work starts: the whole recording, the template, every model file, and what is missing for `until`."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from flows.pipeline import STAGES
from tasks.appearance.albedo import held_out_faults
from tasks.appearance.observations import camera_faults
from tasks.appearance.stage import AppearanceParameters
from tasks.capture.recording import Recording
from tasks.capture.template import Template, read_template
from tasks.cloth.tracked_scene import FEWEST_FRAMES
from tasks.geometry.faults import BadInput, Fault, refuse
from tasks.geometry.parts import SKIN

FEWEST_CAMERAS = 2


def preflight(settings: Any, until: str) -> None:
    """Raise BadInput with all faults of all inputs that the stages up to `until` will read."""
    wanted = list(STAGES)[: list(STAGES).index(until) + 1]
    faults: list[Fault] = []
    checks: dict[str, Callable[[Any], None]] = {"keypoints": _detector, "body": _body_model}
    try:
        recording, template = _recording(settings)
        faults += _too_few_cameras(recording) if len(wanted) > 1 else []
        faults += _appearance(recording, settings.appearance) if "appearance" in wanted else []
        _surface(recording, template, wanted)
    except BadInput as bad:
        faults += bad.faults
    for stage in wanted:
        try:
            checks.get(stage, _nothing)(settings)
        except BadInput as bad:
            faults += bad.faults
    refuse(faults)


def _recording(settings: Any) -> tuple[Recording, Template | None]:
    from tasks.capture.stage import read_recording

    recording = read_recording(settings.capture)
    return recording, None if recording.template is None else read_template(recording.template)


def _surface(recording: Recording, template: Template | None, wanted: list[str]) -> None:
    """Whether there is a surface to track, and garments on it to simulate, where these are wanted."""
    where = str(recording.root)
    if "tracking" in wanted and template is None and recording.mask is None:
        remedy = "Put the first frame's mesh at template/template.obj, or masks beside the pictures, or stop earlier: --until body."
        raise BadInput([Fault(where, "there is neither a template nor a mask: no surface to track", remedy)])
    if "cloth" in wanted and (template is None or set(template.part) <= {SKIN}):
        named = recording.template or "template/template.obj"
        remedy = f"Give {named} the garments' faces by name (g skirt, g top …), or stop earlier: --until skinning."
        what = "there is no template" if template is None else f"{recording.template} has no part but {SKIN!r}"
        raise BadInput([Fault(where, f"{what}: no garment to simulate", remedy)])
    if "cloth" in wanted and len(recording.frames) < FEWEST_FRAMES:
        remedy = f"Record at least {FEWEST_FRAMES}, or stop earlier: --until skinning."
        raise BadInput([Fault(where, f"{len(recording.frames)} frames tell nothing of how cloth moves", remedy)])


def _too_few_cameras(recording: Recording) -> list[Fault]:
    found = len(recording.cameras)
    remedy = f"Record with {FEWEST_CAMERAS} or more, select more of them (capture.cameras), or stop earlier: --until capture."
    what = f"there is {found} camera, and nothing in space can be told from one"
    return [Fault(str(recording.root), what, remedy)] if found < FEWEST_CAMERAS else []


def _appearance(recording: Recording, asked: AppearanceParameters) -> list[Fault]:
    """What pictures without masks, or cameras that cannot be drawn, would say after hours: appearance comes last."""
    where, earlier = str(recording.root), "or stop earlier: --until gap, or --until cloth."
    faults = camera_faults(recording.cameras, asked.reduce) + held_out_faults(recording.cameras, asked.judges(recording.cameras))
    if recording.mask is None:
        faults.append(Fault("masks", "there are none: no pixel is known to be the actor's", "Put masks beside the pictures."))
    return [Fault(f"{where}: {f.where}", f.what, f"{f.remedy.removesuffix('.')}, {earlier}") for f in faults]


def _detector(settings: Any) -> None:
    from tasks.capture.stage import read_recording
    from tasks.keypoints.detector import Detector
    from tasks.keypoints.keypoint_files import read_keypoints

    asked = settings.keypoints
    if asked.file is None:
        Detector.load(Path(asked.model))
        return
    if not Path(asked.file).exists():
        raise BadInput([Fault(str(asked.file), "no such file or folder", "Point keypoints.file at detections, or leave the setting out.")])
    try:
        recording = read_recording(settings.capture)
    except BadInput:  # told already, and without it nobody knows whose keypoints these should be
        return
    read_keypoints(asked.file, recording.cameras.names, frames=len(recording.frames), pixel_centre=asked.pixel_centre)


def _body_model(settings: Any) -> None:
    from tasks.body.model import BodyModel

    if settings.body.model is not None:
        BodyModel.load(Path(settings.body.model))


def _nothing(settings: Any) -> None:
    """Stages without inputs of their own."""
