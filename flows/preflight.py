"""Everything that can be found wrong before work starts: the whole recording, the template, and every model file."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from flows.pipeline import STAGES
from tasks.geometry.faults import BadInput, Fault, refuse


def preflight(settings: Any, until: str) -> None:
    """Raise BadInput with all faults of all inputs that the stages up to `until` will read."""
    wanted = list(STAGES)[: list(STAGES).index(until) + 1]
    checks: dict[str, Callable[[Any], None]] = {"capture": _recording, "keypoints": _detector, "body": _body_model}
    faults: list[Fault] = []
    for stage in wanted:
        try:
            checks.get(stage, _nothing)(settings)
        except BadInput as bad:
            faults += bad.faults
    refuse(faults)


def _recording(settings: Any) -> None:
    from tasks.capture.stage import read_recording
    from tasks.capture.template import read_template

    recording = read_recording(settings.capture)
    if recording.template is not None:
        read_template(recording.template)


def _detector(settings: Any) -> None:
    from tasks.keypoints.detector import Detector

    if settings.keypoints.file is None:
        Detector.load(Path(settings.keypoints.model))
    elif not Path(settings.keypoints.file).exists():
        raise BadInput(
            [Fault(str(settings.keypoints.file), "no such file or folder", "Point keypoints.file at detections, or leave it empty.")]
        )


def _body_model(settings: Any) -> None:
    from tasks.body.model import BodyModel

    if settings.body.model is not None:
        BodyModel.load(Path(settings.body.model))


def _nothing(settings: Any) -> None:
    """Stages without inputs of their own."""
