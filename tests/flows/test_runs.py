"""Records of runs: who carries one out, whether he still does, and whom `cancel` may signal."""

import json
import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from flows import cli
from flows.runs import RunRecord, find_run, list_runs
from storage_schemas.lease import Owner
from storage_schemas.object_store import open_store
from storage_schemas.store import Store

SLEEP = [sys.executable, "-c", "import time; time.sleep(60)"]


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Store("artifacts")
    return tmp_path


@pytest.fixture
def bystander():
    """A process of this machine that has nothing to do with any run."""
    process = subprocess.Popen(SLEEP)
    yield process
    process.kill()
    process.wait()


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        cli.main(list(arguments))
    return ended.value.code


def recorded(place, **of_the_owner) -> RunRecord:
    """A run that this process carries out, but for what is said otherwise."""
    record = RunRecord(place / "artifacts", "ann", "one", owner=Owner.this_process().model_copy(update=of_the_owner))
    record.say("begun")
    return record


def started_of(pid: int) -> int:
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[19])


def test_a_run_of_another_machine_is_shown_and_not_cancelled(place, capsys, bystander):
    """Two machines share a store: the number of its process means another one here."""
    record = recorded(place, host="othermachine", machine="another boot", pid=bystander.pid)
    assert find_run(record.root, None)["state"] == "running"
    assert run("cancel") == 2
    assert "on othermachine" in capsys.readouterr().err
    assert bystander.poll() is None


def test_a_number_that_belongs_to_another_process_by_now_is_not_signalled(place, capsys, bystander):
    record = recorded(place, pid=bystander.pid, started=started_of(bystander.pid) - 1)
    assert find_run(record.root, None)["state"] == "died"
    assert run("cancel") == 2
    assert "it died" in capsys.readouterr().err
    assert bystander.poll() is None


def test_a_run_from_before_this_machine_was_started_anew_has_died(place):
    assert list_runs(recorded(place, machine="an earlier boot").root)[0]["state"] == "died"


def test_a_run_here_is_cancelled(place, bystander):
    recorded(place, pid=bystander.pid, started=started_of(bystander.pid))
    assert run("cancel") == 0
    assert bystander.wait(10) == -signal.SIGTERM


def test_a_run_of_the_service_is_cancelled_there(place, capsys, bystander):
    """Its process would be asked, end, and be replaced."""
    here = {"pid": bystander.pid, "started": started_of(bystander.pid)}
    served = recorded(place, **here)
    served.flow_run = "3f0a"
    served.write()
    for named in ([], [served.id]):
        assert run("cancel", *named) == 2
        assert "cancel ann 'one' in the Prefect UI" in capsys.readouterr().err
    assert bystander.poll() is None
    own = recorded(place, **here)
    own.file.rename(own.file.with_name(f"0{own.file.name}"))  # an older one
    assert run("cancel") == 0
    assert bystander.wait(10) == -signal.SIGTERM


def test_a_record_that_does_not_say_when_its_process_began_is_of_a_run_that_is_over(place, bystander):
    """As records from before 2026-11-25."""
    record = recorded(place)
    old = {name: value for name, value in json.loads(record.file.read_text()).items() if name != "owner"}
    record.file.write_text(json.dumps(old | {"pid": bystander.pid}))
    assert run("cancel") == 2
    assert bystander.poll() is None


@pytest.mark.parametrize("named", ["configuration", "flag"])
def test_runs_of_an_object_store_are_found_where_they_are_written(tmp_path, monkeypatch, capsys, named):
    """Records lie in the store's local part; nothing here speaks to the bucket."""
    url, flag = "s3://bucket/prefix", []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PHYSAVATAR_CACHE", str(tmp_path / "cache"))
    if named == "flag":
        flag = ["--store", url]
    else:
        monkeypatch.setenv("PHYSAVATAR_STORE", url)
    record = RunRecord(open_store(url).root, "ann", "one")
    record.say("begun")
    assert run("status", "--json", *flag) == 0
    assert [found["id"] for found in json.loads(capsys.readouterr().out)] == [record.id]
    assert run("logs", *flag) == 0
    assert "begun" in capsys.readouterr().out
    record.end("completed")
    assert run("cancel", *flag) == 2
    assert "it completed" in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["cache"]


def test_two_runs_of_one_second_and_process_number_have_two_records(tmp_path):
    """As two containers over one store may have."""
    first, *others = [RunRecord(tmp_path, "ann", "one") for _ in range(3)]
    assert len({record.id for record in (first, *others)}) == 3
    assert all(record.id.split("-")[2] == str(os.getpid()) for record in (first, *others))


def test_a_record_may_be_told_from_threads(tmp_path):
    """All write the same file aside, and one may put it in its place before another does."""
    record = RunRecord(tmp_path, "ann", "one")
    with record.stage("gap", "key") as told, ThreadPoolExecutor(8) as threads:
        for _ in range(3):
            list(threads.map(lambda n: (told.progress(n / 100, "refit"), record.write()), range(100)))
        told.warn("done")
    assert json.loads(record.file.read_text())["stages"]["gap"]["warnings"] == ["done"]
