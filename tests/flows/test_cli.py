"""The command line's endings: what a user meets when something is wrong, and that nothing is touched then."""

import json
import os
import subprocess
import sys

import pytest

from flows import cli
from flows.service import hand_over
from storage_schemas.store import Store
from tests.flows.recordings import tiny_recording


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").mkdir()
    return tmp_path


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        cli.main(list(arguments))
    return ended.value.code


def test_a_reader_who_has_enough_is_no_error():
    """stdout is a pipe that nobody reads, as after `| head`."""
    unread, stdout = os.pipe()
    os.close(unread)
    ended = subprocess.run(
        [sys.executable, "-m", "flows", "effects", "--json"], stdout=stdout, stderr=subprocess.PIPE, text=True, check=False
    )
    os.close(stdout)
    assert (ended.returncode, ended.stderr) == (0, "")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["submit", "nobody"], "there is no such actor"),
        (["submit", "../../etc"], "is not a name"),
        (["plan", "nobody", "--set", "cloth.densty=3"], "Did you mean 'density'"),
        (["submit", "nobody", "--until", "dessert"], "there is no stage 'dessert'"),
        (["logs"], "there are no runs yet"),
        (["cancel", "x"], "no run's id begins with 'x'"),
        (["artifacts", "show", "ff"], "there is no store"),
        (["frobnicate"], ""),
    ],
)
def test_bad_requests_end_with_2_and_a_remedy(place, capsys, arguments, said):
    assert run(*arguments) == 2
    captured = capsys.readouterr()
    assert said in captured.err.replace("\n", " ")
    assert captured.out == ""


def test_an_actor_without_sequences_is_told(place, capsys):
    (place / "data" / "ann").mkdir()
    assert run("submit", "ann") == 2
    assert "0 sequences" in capsys.readouterr().err


def test_a_recording_may_lie_anywhere(place, capsys):
    tiny_recording(place / "elsewhere", actor="camera-7", sequence="walk")
    assert run("plan", "ann", "--until", "capture", "--set", "capture.recording=elsewhere/camera-7/walk", "--json") == 0
    assert [row["stage"] for row in json.loads(capsys.readouterr().out)] == ["capture"]
    assert run("plan", "ann", "--until", "capture", "--set", "capture.recording=nowhere") == 2
    assert "nowhere" in capsys.readouterr().err


def test_a_plan_renders_nothing(place, capsys, monkeypatch):
    def rendered(*_):
        raise AssertionError("the demo's recording was made for a plan")

    monkeypatch.setattr("flows.submission.ensure_demo", rendered)
    assert run("plan", "demo") == 2
    assert "`demo` is made on first use" in capsys.readouterr().err.replace("\n", " ")


def test_stages_as_json(place, capsys):
    assert run("stages", "--json") == 0
    stages = json.loads(capsys.readouterr().out)
    assert [s["stage"] for s in stages][:3] == ["capture", "keypoints", "body"]
    assert stages[-1]["stage"] == "report"


def test_a_store_from_the_future_is_refused(place, capsys):
    Store("artifacts")
    assert run("artifacts", "ls") == 0
    version = next((place / "artifacts").glob("STORE_VERSION*"))
    version.write_text(version.read_text().replace("1", "999"))
    assert run("artifacts", "ls") == 2
    assert "upgrade physavatar" in capsys.readouterr().err


@pytest.mark.parametrize("flag", ["--no-wait", "--wait=false", "--no-wait=true"])
def test_a_run_in_the_background_waits_for_itself(place, monkeypatch, flag):
    """However it was said: a child that got the word too would start another one, without end."""
    tiny_recording(place / "data", actor="ann", sequence="walk")
    started = []
    monkeypatch.setattr(cli.subprocess, "Popen", lambda command, **more: started.append(command) or type("Child", (), {"pid": 7}))
    assert run("submit", "ann", flag, "--until", "capture", "--set", "cloth.density=300", "--set", "gap.quick=false") == 0
    (command,) = started
    assert command[1:] == [
        *("-m", "flows", "submit", "ann", "--until", "capture", "--set", "cloth.density=300", "--set", "gap.quick=false")
    ]


@pytest.mark.parametrize("flag", ["--no-wait", "--service"])
def test_bad_input_is_told_before_a_run_goes_elsewhere(place, monkeypatch, capsys, flag):
    monkeypatch.setattr(cli.subprocess, "Popen", lambda *_, **__: pytest.fail("started"))
    monkeypatch.setattr(hand_over, "hand_over", lambda *_, **__: pytest.fail("handed over"))
    assert run("submit", "nobody", flag) == 2
    assert "there is no such actor" in capsys.readouterr().err
    tiny_recording(place / "data", actor="ann", sequence="walk")
    assert run("submit", "ann", flag) == 2  # without a template there is nothing to tell cloth from skin
    assert "no garment to simulate" in capsys.readouterr().err
