"""What outlived its run or its supervisor is found and ended; what is at work is left alone. Real processes."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from flows.service.leftovers import RUN_ID, end_orphans, processes
from flows.service.supervisor import MARK, Supervisor, end_marked

SLEEP = [sys.executable, "-c", "import time; time.sleep(60)"]
ENGINES = [[*SLEEP, name] for name in ("prefect.engine", "flows.service")]


@pytest.fixture
def start():
    started = []

    def go(command: list[str], **environment: str) -> subprocess.Popen:
        started.append(subprocess.Popen(command, env={**os.environ, **environment}))
        until = time.monotonic() + 20
        while not Path(f"/proc/{started[-1].pid}/environ").read_text() and time.monotonic() < until:
            time.sleep(0.05)
        return started[-1]

    yield go
    for process in started:
        process.kill()
        process.wait()


def ended(process: subprocess.Popen, seconds: float = 10.0) -> bool:
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        return False
    return True


def wrote(log: Path, seconds: float = 20.0) -> str:
    """Its first word, once there is one."""
    until = time.monotonic() + seconds
    while not log.read_text().strip() and time.monotonic() < until:
        time.sleep(0.05)
    return log.read_text().split()[0]


@pytest.mark.parametrize("command", ENGINES)
def test_a_solver_whose_engine_is_gone_is_ended_and_others_are_not(start, command):
    orphan = start(SLEEP, **{RUN_ID: "gone"})
    engine, solver = start(command, **{RUN_ID: "here"}), start(SLEEP, **{RUN_ID: "here"})
    stranger = start(SLEEP)
    assert orphan.pid in end_orphans()
    assert ended(orphan)
    assert engine.poll() is solver.poll() is stranger.poll() is None
    assert {p.pid: p.is_engine for p in processes() if p.run == "here"} == {engine.pid: True, solver.pid: False}


def test_a_process_whose_arguments_are_no_utf8_hides_no_orphan(start):
    stranger = start([*SLEEP, b"caf\xe9"])
    orphan = start([*SLEEP, b"caf\xe9"], **{RUN_ID: "gone"})
    assert orphan.pid in end_orphans()
    assert ended(orphan) and stranger.poll() is None


def test_a_stopped_orphan_is_ended_too(start):
    orphan = start(SLEEP, **{RUN_ID: "gone"})
    orphan.send_signal(signal.SIGSTOP)
    end_orphans()
    assert ended(orphan)


def test_what_dies_is_started_again_and_all_ends_together(tmp_path):
    told: list[str] = []
    supervisor = Supervisor(tmp_path, os.environ, told.append)
    supervisor.keep("worker", SLEEP)
    first = supervisor.kept["worker"].process
    first.kill()
    first.wait()
    supervisor.look()
    second = supervisor.kept["worker"].process
    assert second.pid != first.pid
    assert second.poll() is None
    assert "code -9" in told[0]
    supervisor.end()
    assert second.poll() is not None


def test_what_dies_at_once_is_not_started_in_a_hurry(tmp_path):
    supervisor = Supervisor(tmp_path, os.environ, lambda text: None)
    supervisor.keep("broken", [sys.executable, "-c", "raise SystemExit(3)"])
    starts = 0
    until = time.monotonic() + 1.5
    while time.monotonic() < until:
        before = supervisor.kept["broken"].started
        supervisor.look()
        starts += supervisor.kept["broken"].started != before
        time.sleep(0.02)
    supervisor.end()
    assert 1 <= starts <= 2


def test_a_second_interrupt_leaves_nothing_running(tmp_path):
    supervisor = Supervisor(tmp_path, os.environ, lambda text: None)
    deaf = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('deaf', flush=True); time.sleep(60)"
    supervisor.keep("worker", [sys.executable, "-c", deaf])
    kept = supervisor.kept["worker"]
    assert wrote(kept.log) == "deaf"
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    signal.setitimer(signal.ITIMER_REAL, 0.3)
    try:
        with pytest.raises(KeyboardInterrupt):
            supervisor.end(grace_s=30)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert ended(kept.process)


def test_what_a_shell_keeps_from_interrupts_still_ends_on_sigterm(tmp_path):
    """As Prefect's workers do, which hand SIGTERM on to themselves as SIGINT; `physavatar up &` in a script starts with SIGINT ignored."""
    supervisor = Supervisor(tmp_path, os.environ, lambda text: None)
    worker = "import os, signal, time; signal.signal(15, lambda *_: os.kill(os.getpid(), 2)); print('ready', flush=True); time.sleep(60)"
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        supervisor.keep("worker", [sys.executable, "-c", worker])
    finally:
        signal.signal(signal.SIGINT, before)
    kept = supervisor.kept["worker"]
    assert wrote(kept.log) == "ready"
    supervisor.end(grace_s=20)
    assert kept.process.returncode == -signal.SIGINT


def test_what_a_killed_supervisor_left_is_found_by_its_mark(tmp_path, start):
    left, other = start(SLEEP, **{MARK: str(tmp_path)}), start(SLEEP, **{MARK: f"{tmp_path}-other"})
    assert end_marked(tmp_path) == [left.pid]
    assert ended(left)
    assert other.poll() is None
