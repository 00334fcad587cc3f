"""Prefect servers that a killed run left behind: ours are ended, those of others are none of our business."""

import os
import subprocess
import sys

import pytest

from flows import orphans


@pytest.fixture
def start(monkeypatch):
    """Starts a process that looks like a server of a home. What is started here counts as left behind by its parent."""
    started = []

    def begin(home, *further, **environment) -> subprocess.Popen:
        command = [sys.executable, "-c", "import time; print(flush=True); time.sleep(60)", orphans.SERVER, *further]
        started.append(subprocess.Popen(command, env={**os.environ, "PREFECT_HOME": str(home), **environment}, stdout=subprocess.PIPE))
        started[-1].stdout.readline()
        return started[-1]

    monkeypatch.setattr(orphans, "_parent", lambda pid: 1 if pid in {process.pid for process in started} else 0)
    yield begin
    for process in started:
        process.kill()
        process.communicate()


def test_a_server_of_this_home_is_ended_and_others_are_not(start, tmp_path):
    ours, other = start(tmp_path / "ours"), start(tmp_path / "other")
    assert orphans.end_orphaned_servers(tmp_path / "ours") == 1
    assert ours.wait(10) < 0 and other.poll() is None


def test_a_process_whose_words_are_no_utf8_hides_no_server(start, tmp_path):
    """Arguments and environment are bytes: the name of a file in Latin-1, say."""
    home = tmp_path / os.fsdecode(b"caf\xe9")
    ours, other = start(home, b"caf\xe9", NAME=b"caf\xe9"), start(tmp_path / "caf\ufffd", b"caf\xe9")
    assert orphans.end_orphaned_servers(home) == 1
    assert ours.wait(10) < 0 and other.poll() is None


def test_the_parent_is_told_whatever_the_process_calls_itself():
    named = "import time; open('/proc/self/comm', 'wb').write(b'caf\\xe9 ) '); print(flush=True); time.sleep(5)"
    with subprocess.Popen([sys.executable, "-c", named], stdout=subprocess.PIPE) as child:
        child.stdout.readline()
        assert orphans._parent(child.pid) == os.getpid()
        child.kill()


def test_a_server_whose_environment_is_closed_to_us_is_passed_over(start, tmp_path, monkeypatch):
    """As that of another user of this workstation is."""
    foreign, ours, home_of = start(tmp_path), start(tmp_path), orphans._home

    def home(pid: int) -> str | None:
        if pid == foreign.pid:
            raise PermissionError(13, "Permission denied", f"/proc/{pid}/environ")
        return home_of(pid)

    monkeypatch.setattr(orphans, "_home", home)
    assert orphans.end_orphaned_servers(tmp_path) == 1
    assert ours.wait(10) < 0 and foreign.poll() is None
