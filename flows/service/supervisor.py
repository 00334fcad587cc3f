"""Processes that are kept running: started again when they die, ended together, none left behind.

Each leads a session of its own and carries KEPT_BY_PHYSAVATAR=<home> in its environment, which everything it starts inherits: by that, what
outlived a killed supervisor is found. Linux.
"""

import os
import signal
import subprocess
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

MARK = "KEPT_BY_PHYSAVATAR"  # not PHYSAVATAR_…: that would be a setting, and an unknown one
HEEDING_INTERRUPTS = ("env", "--default-signal=INT")  # a shell's `&` has SIGINT ignored, by which Prefect's workers end on SIGTERM
GRACE_S = 15.0
PAUSE_S = (0.0, 1.0, 5.0, 15.0, 30.0)  # before the first, second, … start again; a run of five minutes counts as a success
SUCCESS_S = 300.0


@dataclass
class Kept:
    """One process: how to start it, and how often it has died."""

    name: str
    command: list[str]
    log: Path
    process: subprocess.Popen | None = None
    started: float = 0.0
    deaths: int = 0
    again_at: float = 0.0


@dataclass
class Supervisor:
    """Starts, restarts and ends processes. `tell` is told of deaths."""

    home: Path
    environment: Mapping[str, str]
    tell: Callable[[str], None] = print
    kept: dict[str, Kept] = field(default_factory=dict)

    def keep(self, name: str, command: list[str]) -> None:
        """Start it and keep it running; its output goes to <home>/logs/<name>.log."""
        log = self.home / "logs" / f"{name}.log"
        log.parent.mkdir(exist_ok=True)
        self.kept[name] = Kept(name, command, log)
        self._start(self.kept[name])

    def look(self) -> None:
        """Start again what has died and has waited long enough."""
        for kept in list(self.kept.values()):  # another thread may have one more kept
            if kept.process is not None and kept.process.poll() is not None:
                lived = time.monotonic() - kept.started
                kept.deaths = 1 if lived > SUCCESS_S else kept.deaths + 1
                kept.again_at = time.monotonic() + PAUSE_S[min(kept.deaths, len(PAUSE_S)) - 1]
                self.tell(f"{kept.name} ended with code {kept.process.returncode} after {lived:.0f} s, see {kept.log}; starting it again")
                kept.process = None
            if kept.process is None and time.monotonic() >= kept.again_at:
                self._start(kept)

    def end(self, grace_s: float = GRACE_S) -> None:
        """Ask all but the first, all at once, then the first, which they may need to say goodbye; kill what does not end and what it started.

        A second interrupt meanwhile kills all at once.
        """
        running = [kept.process for kept in self.kept.values() if kept.process is not None]
        try:
            for together in (running[1:], running[:1]):
                for process in together:
                    _signal_group(process.pid, signal.SIGTERM)
                until = time.monotonic() + grace_s
                for process in together:
                    try:
                        process.wait(max(until - time.monotonic(), 0.0))
                    except subprocess.TimeoutExpired:
                        _signal_group(process.pid, signal.SIGKILL)
                        process.wait()
        finally:
            end_marked(self.home)

    def _start(self, kept: Kept) -> None:
        environment = {**self.environment, MARK: str(self.home)}
        with kept.log.open("ab") as log:
            kept.process = subprocess.Popen(
                [*HEEDING_INTERRUPTS, *kept.command],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        kept.started = time.monotonic()


def end_marked(home: Path) -> list[int]:
    """Kill whatever a supervisor of this home left running; their numbers."""
    ended = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            marked = f"{MARK}={home}\0" in (entry / "environ").read_text(errors="replace")
        except OSError:
            continue
        if marked and int(entry.name) != os.getpid():
            try:
                os.kill(int(entry.name), signal.SIGKILL)
            except ProcessLookupError:
                continue
            ended.append(int(entry.name))
    return ended


def _signal_group(pid: int, number: signal.Signals) -> None:
    try:
        os.killpg(pid, number)
    except ProcessLookupError:
        return
