"""`--with-effect`: another key for the cloth and what follows from it, none for what comes before; and names that nobody knows."""

import json

import pytest
from rich.console import Console

from flows import cli
from flows.endings import Refused
from flows.submission import Submission
from storage_schemas.provenance import Provenance
from tests.flows.recordings import tiny_recording
from tests.storage_schemas.examples import examples


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        cli.main(list(arguments))
    return ended.value.code


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    tiny_recording(tmp_path / "data")
    return tmp_path


@pytest.fixture
def finished(place):
    """A store in which every stage has an artifact under the key of the default parameters."""
    submission = Submission.prepare("ann", None, until="report", overrides=(), store=None, console=Console(stderr=True))
    request, store, records = submission.request, submission.store, examples()

    def publish(stage, inputs, done):
        fields = stage.key_fields(inputs, parameters := request.parameters(stage, done, store))
        told = Provenance(
            stage=stage.name,
            stage_version=stage.version,
            inputs=inputs,
            weights=fields["weights"],
            parameters=fields["parameters"],
        ).finished()
        key = stage.key(inputs, parameters)
        record = records[stage.writes.schema_name]
        ref = store.publish(record, actor=request.actor, sequence=request.sequence, stage=stage.name, key=key, provenance=told)
        store.set_latest(ref)
        return ref

    request.line.walk("report", publish)
    return place


def planned(capsys, *arguments: str) -> dict[str, dict]:
    assert run("plan", "ann", "--json", *arguments) == 0
    return {row["stage"]: row for row in json.loads(capsys.readouterr().out)}


def test_the_cloth_and_what_follows_run_again_and_nothing_before(finished, capsys):
    assert all(row["cached"] for row in planned(capsys).values())
    again = planned(capsys, "--explain", "--set", "cloth.effects=air_normal_drag")
    assert {name for name, row in again.items() if not row["cached"]} == {"cloth", "gap", "report"}
    assert "parameters.effects: [] → ['air_normal_drag']" in again["cloth"]["why"]


def test_the_key_is_that_of_the_set_of_effects(finished, capsys):
    keys = {
        names: planned(capsys, "--set", f"cloth.effects={names}")["cloth"]["key"] for names in ("air_lift", "air_wind", "air_lift,air_lift")
    }
    assert keys["air_lift"] != keys["air_wind"]
    assert keys["air_lift"] == keys["air_lift,air_lift"]


def test_a_rerun_adds_to_the_effects_that_are_set(finished, monkeypatch):
    asked = {}

    def stop(self):
        asked["effects"] = self.request.settings.cloth.effects
        raise Refused("far enough")

    monkeypatch.setattr(Submission, "run", stop)
    more = ("--with-effect", "air_normal_drag", "--with-effect", "gravity_tilt")
    assert run("rerun", "ann", "--set", "cloth.effects=contact_friction", *more) == 2
    assert asked["effects"] == ("contact_friction", "air_normal_drag", "gravity_tilt")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["rerun", "ann", "--with-effect", "air_normal_dragg"], "Did you mean 'air_normal_drag'"),
        (["rerun", "ann", "--with-effect", "numerics_mesh"], "there is no effect 'numerics_mesh'"),
        (["plan", "ann", "--set", "cloth.effects=wind"], "Did you mean 'air_wind'"),
        (["submit", "ann", "--set", "cloth.effects=air_wind", "--set", "cloth.method=adam-fd"], "leave out one of the two"),
        (["rerun", "ann"], "name a stage (--from) or an effect (--with-effect)"),
        (["cloth", "fit", "data", "--with-effect", "air_drag"], "there is no effect 'air_drag'"),
    ],
)
def test_what_cannot_be_added_is_refused(place, capsys, arguments, said):
    assert run(*arguments) == 2
    assert said in capsys.readouterr().err.replace("\n", " ")
    assert not list((place / "artifacts").rglob("manifest.json"))


def test_an_artifact_that_is_swept_between_plan_and_use_is_told(finished, monkeypatch):
    submission = Submission.prepare("ann", None, until="report", overrides=(), store=None, console=Console(stderr=True))
    planned = submission.check()
    monkeypatch.setattr(Submission, "check", lambda self: planned)
    submission.store.retire(submission.store.latest("ann", "one", "cloth"))
    with pytest.raises(Refused, match=r"cloth has been removed since.*submit again"):
        submission.run()
