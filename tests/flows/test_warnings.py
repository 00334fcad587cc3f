"""What a stage warns of reaches whoever asked: on the console once, as it comes, in the run's record, and again when the artifact was there."""

import io
import json
from types import SimpleNamespace

import pytest
from rich.console import Console

from flows import cli
from flows.config import load
from flows.pipeline import AVATAR, STAGES
from flows.progress import bars
from flows.request import Request, run_stage
from flows.runs import RunRecord
from storage_schemas.store import Store
from tasks.stage import Stage
from tests.flows.recordings import tiny_recording
from tests.storage_schemas.examples import examples, key_of, provenance

SAID = "left and right [of Cam001] look alike"
YELLOW = "\x1b[33m"


@pytest.mark.parametrize("terminal", [False, True])
def test_a_warning_is_on_the_console_once_as_it_comes(tmp_path, terminal):
    shown = io.StringIO()
    record = RunRecord(tmp_path, "ann", "one")
    with bars(record, Console(file=shown, force_terminal=terminal, width=200)), record.stage("keypoints", "key") as told:
        told.warn(SAID)
        line = f"{YELLOW}keypoints: {SAID}" if terminal else f"keypoints: {SAID}\n"
        assert line in shown.getvalue()
        told.progress(0.5, "half")
        told.warn(SAID)  # by another try of the stage
        told.warn("another")
        told.done(cached=False, seconds=1.0)
    assert shown.getvalue().count(f"keypoints: {SAID}") == shown.getvalue().count("keypoints: another") == 1


@pytest.mark.parametrize(("noted", "kept"), [((), (SAID,)), ((SAID,), (SAID,)), ((), ())], ids=["before", "now", "none"])
def test_warnings_of_a_stage_that_was_in_the_store_are_told_again(tmp_path, monkeypatch, capsys, noted, kept):
    """noted: by its provenance, as since warnings are kept there; kept: by the capture itself."""
    monkeypatch.chdir(tmp_path)
    recording = tiny_recording(tmp_path / "data")
    captured = examples()["capture"].model_copy(update={"warnings": kept})
    at = {"actor": "ann", "sequence": "one", "stage": "capture"}
    key = STAGES["capture"].key({}, load([f"capture.recording={recording}"]).capture)
    Store("artifacts").publish(captured, **at, key=key, provenance=provenance().model_copy(update={"reasons": noted}))
    with pytest.raises(SystemExit) as ended:
        cli.main(["submit", "ann", "--until", "capture", "--json"])
    assert ended.value.code == 0
    told = capsys.readouterr()
    entry = json.loads(told.out)["stages"]["capture"]
    assert (entry["state"], entry["warnings"]) == ("cached", list(kept))
    assert told.err.count(f"capture: {SAID}") == len(kept)


def test_they_are_told_again_too_where_a_later_stage_is_computed(tmp_path, monkeypatch):
    """The run then goes through Prefect, whose task found the artifact."""
    store = Store(tmp_path / "store")
    at = {"actor": "ann", "sequence": "one", "stage": "keypoints", "key": key_of(0)}
    ref = store.publish(examples()["keypoints"], **at, provenance=provenance().model_copy(update={"reasons": (SAID,)}))
    result = {"ref": ref.model_dump(mode="json"), "cached": True, "seconds": 0.1}
    monkeypatch.setattr(Stage, "as_task", lambda *_, **__: lambda *_: SimpleNamespace(result=lambda: result))
    record = RunRecord(tmp_path, "ann", "one")
    request = Request("ann", "one", load([f"capture.recording={tmp_path}"]), AVATAR)
    assert run_stage(request, store, record, STAGES["keypoints"], {}, {}) == ref
    assert record.stages["keypoints"]["warnings"] == [SAID]


def test_the_report_is_told_what_was_warned_of_and_of_nothing_else_but_before(tmp_path):
    store = Store(tmp_path / "store")

    def stages(*noted: str) -> dict:
        at = {"actor": "ann", "sequence": "one", "stage": "keypoints", "key": key_of(len(noted))}
        origin = provenance().model_copy(update={"reasons": noted})
        ref = store.publish(examples()["keypoints"], **at, provenance=origin)
        request = Request("ann", "one", load(), AVATAR)
        return request.parameters(STAGES["report"], {"keypoints": ref}, store).stages["keypoints"]

    assert stages(SAID)["warnings"] == [SAID]
    assert stages().keys() == {"seconds", "key"}  # else every report there is would have another key
