"""What the UI is shown of a stage: a picture over the recording, the verdict, the report; and that a UI that is away harms nothing."""

import base64
import hashlib
import io
import logging
import re

import httpx
import numpy as np
import pytest
from PIL import Image

from flows.pipeline import STAGES
from flows.service import pictures
from storage_schemas.provenance import Provenance
from storage_schemas.store import Store
from tests.storage_schemas.examples import examples

SIZE, SENTENCE = 64, "The fitted cloth differs from the recording by 9.0 mm; the cause is air_normal_drag."
ANSWER = {"verdict": {"sentence": SENTENCE}, "ranking": [{"class": ["air_normal_drag"], "probability": 0.97}]}


@pytest.fixture
def shown(tmp_path, monkeypatch):
    """(show a record of this kind, what reached the UI by kind of artifact)."""
    files = {f"{camera}/{n}.png": n for camera in ("left", "right") for n in range(3)}
    sha256 = {}
    for name, n in files.items():
        path = tmp_path / "recording" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(np.full((SIZE, SIZE, 3), 40 * n, np.uint8)).save(path)
        sha256[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    known, store, said = examples(), Store(tmp_path / "store"), {}
    rig = {"size": np.full((2, 2), SIZE, "int32"), "K": np.tile([[50.0, 0, 32], [0, 50, 32], [0, 0, 1]], (2, 1, 1))}
    recording = {"rgb": ("left/{frame}.png", "right/{frame}.png"), "frame_numbers": np.arange(3, dtype="int32"), "template": None}
    known["capture"] = known["capture"].model_copy(update=rig | recording | {"sha256": sha256, "t": np.tile([0.0, 0, 3], (2, 1))})
    known["gap"] = known["gap"].model_copy(update={"verdict": ANSWER})
    for kind in ("markdown", "link"):
        monkeypatch.setattr(pictures, f"create_{kind}_artifact", lambda *a, k=kind, **more: said.setdefault(k, []).append((a, more)))
    monkeypatch.setattr(pictures, "get_run_logger", lambda: logging.getLogger("test"))

    def publish(stage):
        return store.publish(
            known[stage], actor="ann", sequence="one", stage=stage, key="a" * 64, provenance=Provenance(stage=stage, stage_version=1)
        )

    capture = publish("capture")

    def show(stage):
        ref = capture if stage == "capture" else publish(stage)
        pictures.show(store, STAGES[stage], ref, {"capture": capture}, tmp_path / "recording")

    return show, said


def seen_in(page: str) -> Image.Image:
    """The picture of a page."""
    return Image.open(io.BytesIO(base64.b64decode(re.fullmatch(r"!\[[^]]+\]\(data:image/jpeg;base64,([^)]+)\)", page)[1])))


@pytest.mark.parametrize("stage", ["capture", "keypoints", "body", "tracking", "cloth"])
def test_a_stage_is_seen(shown, stage):
    show, said = shown
    show(stage)
    ((((page,), more)),) = said["markdown"]
    assert more == {"key": f"ann-one-{stage}-picture", "description": f"ann one: {stage}"}
    picture = seen_in(page)
    assert picture.format == "JPEG" and max(picture.size) <= pictures.WIDTH


def test_the_last_frame_is_shown(shown):
    show, said = shown
    show("capture")
    (((page,), _),) = said["markdown"]
    assert np.asarray(seen_in(page)).mean() == pytest.approx(80, abs=2)


def test_the_verdict_is_told_in_its_own_words(shown):
    show, said = shown
    show("gap")
    (((text,), more),) = said["markdown"]
    assert SENTENCE in text and "| air_normal_drag | 97% |" in text
    assert re.search(r"\[What it rests on\]\(file:///.*/files/gap.html\), `/", text)
    assert more["key"] == "ann-one-verdict"


def test_the_report_is_linked(shown):
    show, said = shown
    show("report")
    (((link,), _),) = said["link"]
    assert link.startswith("file:///") and link.endswith("/files/report.html")


@pytest.mark.parametrize("trouble", [httpx.ConnectError("down"), FileNotFoundError("the recording has moved")])
def test_what_cannot_be_shown_harms_nothing(shown, monkeypatch, caplog, trouble):
    def refuse(*_, **__):
        raise trouble

    monkeypatch.setattr(pictures, "create_markdown_artifact", refuse)
    shown[0]("body")
    assert "body: nothing to look at" in caplog.text
