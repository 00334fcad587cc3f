"""A store is named by a folder or by a URL, and a URL reaches the object store whole, from every command."""

import json
import os
import time
from types import SimpleNamespace

import numpy as np
import pytest

from flows import cli, submission
from flows.endings import Refused
from storage_schemas.faults import StoreFault
from storage_schemas.object_store import open_store
from storage_schemas.provenance import Provenance
from storage_schemas.reference import ArtifactRef
from storage_schemas.store import Store
from tasks.cloth import stage as cloth_stage
from tests.flows.recordings import tiny_recording
from tests.storage_schemas.examples import examples, key_of


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PHYSAVATAR_CACHE", str(tmp_path / "cache"))
    (tmp_path / "bucket").mkdir()
    (tmp_path / "data").mkdir()
    return tmp_path


@pytest.fixture
def url(place):
    """An object store that needs no server: obstore speaks to a folder as it does to S3."""
    return f"file://{place}/bucket"


def run(*arguments) -> int:
    with pytest.raises(SystemExit) as ended:
        cli.main([str(argument) for argument in arguments])
    return ended.value.code


def put(store: Store, stage: str = "report", number: int = 0) -> ArtifactRef:
    at = {"actor": "ann", "sequence": "walk", "stage": stage, "key": key_of(number, stage)}
    ref = store.publish(examples()[stage], **at, provenance=Provenance(stage=stage, stage_version=1))
    store.set_latest(ref)
    return ref


def test_the_artifacts_are_those_below_the_url(place, url, capsys):
    ref = put(open_store(url))
    assert run("artifacts", "ls", "--json", "--store", url) == 0
    assert [entry["digest"] for entry in json.loads(capsys.readouterr().out)] == [ref.digest]
    assert run("artifacts", "show", ref.key[:8], "--store", url) == 0
    assert json.loads(capsys.readouterr().out)["manifest"]["schema_name"] == "report"
    assert not (place / "file:").exists()


def test_the_dataset_and_the_export_look_below_the_url(place, url, capsys):
    (place / "data/ann/walk").mkdir(parents=True)
    put(open_store(url))
    assert run("dataset", "report", "page.html", "--store", url) == 0
    assert "ann" in (place / "page.html").read_text()
    capsys.readouterr()
    assert run("export", "ann", "out", "--store", url) == 2
    assert "ann walk has no cloth yet" in capsys.readouterr().err
    assert not (place / "file:").exists()


def test_a_fabric_is_published_below_the_url(place, url, capsys, monkeypatch):
    def refuse(store, *_, **__):
        raise Refused(f"would publish in {store.location} as {type(store).__name__}")

    monkeypatch.setattr(cloth_stage, "track_fit", SimpleNamespace(run=refuse))
    np.savez(place / "track.npz", vertices=np.zeros((2, 3, 3)))
    assert run("cloth", "fit", "track.npz", "--store", url) == 2
    assert f"would publish in {url} as ObjectStore" in capsys.readouterr().err.replace("\n", "")
    assert not (place / "file:").exists()


def test_the_diagnosis_is_asked_for_below_the_url(place, url, capsys, monkeypatch):
    def prepare(*_, store, **__):
        raise Refused(f"would look in {store}")

    monkeypatch.setattr(submission.Submission, "prepare", prepare)
    assert run("gap", "ann", "--store", url) == 2
    assert f"would look in {url}" in capsys.readouterr().err.replace("\n", "")


def aged(store: Store, ref: ArtifactRef) -> ArtifactRef:
    """As if nobody had asked for it for a month; no stage points to it either."""
    then = time.time() - 30 * 86400
    os.utime(store.folder(ref) / "manifest.json", (then, then))
    (store.folder(ref).parent / ".latest.json").unlink(missing_ok=True)
    return ref


def test_json_of_a_sweep_is_what_was_swept(place, capsys):
    store = open_store("artifacts")
    ref = aged(store, put(store))
    assert run("artifacts", "gc", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["artifacts"] == [str(ref.address)] and told["left_overs"] == [] and told["bytes"] > 1000
    assert store.list() == []


def test_a_pinned_artifact_outlives_a_sweep_until_it_is_let_go(place, capsys):
    store = open_store("artifacts")
    pinned, other = aged(store, put(store)), aged(store, put(store, "skinning"))
    assert run("artifacts", "pin", pinned.key[:8], "figure 3 of the paper") == 0
    assert run("artifacts", "gc", "--json") == 0
    assert [entry.address for entry in store.list()] == [pinned.address]
    assert run("artifacts", "pin", other.key[:8], "why") == 2
    assert run("artifacts", "unpin", pinned.key[:8]) == 0
    assert run("artifacts", "gc", "--json") == 0
    assert store.list() == []


LOOKING = [
    *(["artifacts", *words] for words in (["ls"], ["show", "ff"], ["verify"], ["gc"], ["pin", "ff", "why"], ["unpin", "ff"])),
    ["export", "ann", "out"],
    ["dataset", "status"],
    ["dataset", "report", "page.html"],
]


@pytest.mark.parametrize("command", LOOKING, ids=" ".join)
def test_looking_into_a_store_makes_none(place, capsys, command):
    before = sorted(place.rglob("*"))
    for flag, named in ([], "artifacts"), (["--store", "typo_store"], "typo_store"):
        assert run(*command, *flag) == 2
        said = capsys.readouterr()
        assert f"{place / named}: there is no store. " in said.err and "`physavatar submit` makes one" in said.err
        assert said.out == ""
    assert sorted(place.rglob("*")) == before


@pytest.mark.parametrize("command", ["status", "logs", "cancel"])
def test_a_store_that_is_named_must_be_there_and_the_usual_one_has_had_no_runs_yet(place, capsys, command):
    assert run(command) == (0 if command == "status" else 2)
    assert "there is no store" not in capsys.readouterr().err
    assert run(command, "--store", "typo_store") == 2
    assert f"{place / 'typo_store'}: there is no store. " in capsys.readouterr().err
    assert sorted(path.name for path in place.iterdir()) == ["bucket", "data"]


@pytest.mark.parametrize("command", [["plan", "ann", "--until", "capture"], ["dataset", "plan"]], ids=" ".join)
def test_a_plan_makes_no_store_and_all_is_to_be_done(place, capsys, command):
    tiny_recording(place / "data")
    assert run(*command, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["counts"] == {"new": 1} if command[0] == "dataset" else [row["cached"] for row in told] == [False]
    assert sorted(path.name for path in place.iterdir()) == ["bucket", "data"]


@pytest.mark.parametrize("command", [["artifacts", "ls"], ["submit", "ann", "--until", "capture"]], ids=" ".join)
@pytest.mark.parametrize("location", ["good.npz", "/proc/x", "s3://", "ftp://x/y", "s3://a b/c", "file:///nowhere/at/all", "data"])
def test_a_place_that_cannot_be_a_store_is_named_and_left_as_it_is(place, capsys, command, location):
    tiny_recording(place / "data")
    (place / "good.npz").write_bytes(b"tracked")
    before = sorted(place.rglob("*"))
    assert run(*command, "--store", location) == 2
    assert f"{location}: " in capsys.readouterr().err.replace("\n", "")
    assert sorted(place.rglob("*")) == before


@pytest.mark.parametrize("days", ["nan", "-1", "inf", "1e12"])
def test_an_age_that_is_none_sweeps_nothing(place, capsys, days):
    store = open_store("artifacts")
    aged(store, put(store))
    assert run("artifacts", "gc", f"--older-than-days={days}") == 2
    assert "Give a number of days, 0 to " in capsys.readouterr().err
    assert len(store.list()) == 1


def test_an_object_store_pins_nothing(place, url, capsys):
    ref = put(open_store(url))
    assert run("artifacts", "pin", ref.key[:8], "why", "--store", url) == 2
    assert "life cycle rules" in capsys.readouterr().err


@pytest.mark.parametrize("location", ["s3://bucket/prefix", "s3:/bucket/prefix"])
def test_a_url_is_never_taken_for_a_folder(place, location):
    """A `Path` of a URL has lost a slash; artifacts must not go into ./s3:/bucket."""
    with pytest.raises(StoreFault, match="is a URL and no folder"):
        Store(location)
    assert sorted(path.name for path in place.iterdir()) == ["bucket", "data"]
