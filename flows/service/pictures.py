"""The latest pictures of a sequence, as pages small enough to be shown inside the Prefect UI.

Pages of Markdown, not image artifacts: under an image the UI spells out its address, and these have their content for an address.
Each is drawn from the artifact that a stage has just published, over the recording, at the last frame and in a few cameras. What cannot be
drawn or shown is left out with a line in the log: a picture must not fail what was computed.
"""

import base64
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import httpx
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from prefect.artifacts import create_link_artifact, create_markdown_artifact
from prefect.logging import get_run_logger

from flows.service.shown import artifact_name
from storage_schemas.body import Body
from storage_schemas.capture import Capture
from storage_schemas.cloth import Cloth
from storage_schemas.gap import PAGE, Gap
from storage_schemas.keypoints import Keypoints
from storage_schemas.record import Record
from storage_schemas.reference import ArtifactRef
from storage_schemas.report import Report
from storage_schemas.store import Store
from storage_schemas.tracking import Tracking
from tasks.body.wholebody import LIMBS
from tasks.geometry.cameras import Cameras
from tasks.geometry.faults import BadInput
from tasks.recorded import cameras_of, recorded
from tasks.report.pictures import crop_to, draw_keypoints, draw_mesh, strip
from tasks.stage import Stage

VIEWS, WIDTH, QUALITY = 3, 640, 70


def show(store: Store, stage: Stage, ref: ArtifactRef, done: Mapping[str, ArtifactRef], recording: Path) -> None:
    """What one stage has just made: a picture of it, the verdict of a diagnosis, the way to the report."""
    kind, draw = stage.writes, DRAWN.get(stage.writes)
    try:
        if kind is Gap:
            _show_verdict(store, ref)
        elif kind is Report:
            _show_report(store, ref)
        elif draw is not None:
            record = store.open(ref, kind)
            capture = store.open(ref if kind is Capture else done["capture"], Capture)
            said = f"{ref.actor} {ref.sequence}: {ref.stage}"
            key = artifact_name(ref.actor, ref.sequence, ref.stage, "picture")
            create_markdown_artifact(f"![{said}]({thumbnail(draw(record, _View(capture, recording)))})", key=key, description=said)
    except (httpx.HTTPError, OSError, BadInput) as error:
        get_run_logger().warning("%s: nothing to look at: %s", ref.stage, error)


def thumbnail(image: NDArray[np.uint8]) -> str:
    """A picture [h, w, 3] as a data URL of a small JPEG."""
    small, out = Image.fromarray(image), io.BytesIO()
    small.thumbnail((WIDTH, WIDTH))
    small.save(out, "JPEG", quality=QUALITY)
    return "data:image/jpeg;base64," + base64.b64encode(out.getvalue()).decode()


@dataclass(frozen=True)
class _View:
    """The recording in cameras spread over the rig."""

    capture: Capture
    root: Path

    @cached_property
    def shown(self) -> NDArray[np.int64]:
        """Which cameras."""
        return np.unique(np.linspace(0, len(self.capture.camera_names) - 1, VIEWS).round().astype(int))

    @cached_property
    def rig(self) -> Cameras:
        """Those cameras."""
        return cameras_of(self.capture).subset(self.shown)

    def images(self, t: int) -> list[NDArray[np.uint8]]:
        """Their pictures of frame t."""
        recording = recorded(self.capture, self.root)
        return [recording.read_rgb(int(camera), t) for camera in self.shown]

    def over(self, t: int, vertices: NDArray, faces: NDArray) -> NDArray[np.uint8]:
        """A mesh over the recording."""
        x = vertices.astype(float)
        return strip([crop_to(draw_mesh(i, self.rig, c, x, faces), self.rig, c, x) for c, i in enumerate(self.images(t))])


def _recording(record: Capture, view: _View) -> NDArray[np.uint8]:
    return strip(view.images(len(record.frame_numbers) - 1))


def _keypoints(record: Keypoints, view: _View) -> NDArray[np.uint8]:
    points, score = record.keypoints[-1, view.shown], record.score[-1, view.shown]
    return strip([draw_keypoints(i, p, s, LIMBS) for i, p, s in zip(view.images(len(record.keypoints) - 1), points, score)])


def _surface(record: Body | Tracking, view: _View) -> NDArray[np.uint8]:
    return view.over(len(record.vertices) - 1, record.vertices[-1], record.faces)


def _garments(record: Cloth, view: _View) -> NDArray[np.uint8]:
    return view.over(len(record.simulated) - 1, record.simulated[-1], record.faces)


DRAWN: dict[type[Record], Callable] = {
    Capture: _recording,
    Keypoints: _keypoints,
    Body: _surface,
    Tracking: _surface,
    Cloth: _garments,
}


def _show_verdict(store: Store, ref: ArtifactRef) -> None:
    gap = store.open(ref, Gap)
    rows = "\n".join(
        f"| {', '.join(row['class'])} | {row['probability']:.0%} |" for row in gap.verdict["ranking"][:5] if row["probability"]
    )
    text = f"{gap.verdict['verdict']['sentence']}\n\n| cause | probability |\n|---|---|\n{rows}"
    if PAGE in gap.files:
        page = store.folder(ref) / "files" / PAGE
        text += f"\n\n[What it rests on]({page.as_uri()}), `{page}`"
    said = f"{ref.actor} {ref.sequence}: verdict"
    create_markdown_artifact(text, key=artifact_name(ref.actor, ref.sequence, "verdict"), description=said)


def _show_report(store: Store, ref: ArtifactRef) -> None:
    page = store.folder(ref) / "files" / "report.html"
    key, said = artifact_name(ref.actor, ref.sequence, "report"), f"{ref.actor} {ref.sequence}: report"
    create_link_artifact(page.as_uri(), key=key, link_text=said, description=f"{said}, `{page}`")
