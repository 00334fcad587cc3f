"""Records of runs on this machine: one JSON and one log per run below <store>/.runs, written while it goes on, read by status and logs."""

import json
import os
import secrets
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from flows.endings import Refused
from storage_schemas.lease import Owner

WRITE_EVERY_S = 1.0


@dataclass
class RunRecord:
    """One run as it goes. `listen` is told of every change (the progress bars); the file is written at most once a second. Any thread may tell.

    flow_run: of the service, which does again what only its process was told to stop; None where somebody's command carries the run out.
    The id is no other run's: in two containers over one store, second and process number may be the same.
    """

    root: Path
    actor: str
    sequence: str
    listen: Callable[["RunRecord"], None] = lambda record: None
    id: str = field(default_factory=lambda: f"{datetime.now(UTC):%Y%m%d-%H%M%S}-{os.getpid()}-{secrets.token_hex(3)}")
    flow_run: str | None = None
    state: str = "running"
    owner: Owner = field(default_factory=Owner.this_process)
    started: float = field(default_factory=time.time)
    ended: float | None = None
    stages: dict[str, dict[str, Any]] = field(default_factory=dict)
    error: str | None = None
    _written: float = 0.0
    _telling: threading.RLock = field(default_factory=threading.RLock, repr=False)

    @property
    def file(self) -> Path:
        """Where this record lies."""
        return self.root / ".runs" / f"{self.id}.json"

    @property
    def log(self) -> Path:
        """Where this run's messages lie."""
        return self.file.with_suffix(".log")

    @contextmanager
    def stage(self, name: str, key: str) -> Iterator["StageReport"]:
        """Follow one stage; an exception marks it failed and goes on."""
        entry = self.stages[name] = {"state": "running", "key": key, "fraction": 0.0, "text": "", "started": time.time(), "warnings": []}
        self.say(f"{name}: started ({key[:12]})")
        try:
            yield StageReport(self, name, entry)
        except BaseException as error:
            entry["state"] = "failed"
            self.say(f"{name}: failed: {type(error).__name__}: {error}")
            raise

    def end(self, state: str, error: str | None = None) -> None:
        """completed, failed, cancelled, refused or timed out."""
        self.state, self.error, self.ended = state, error, time.time()
        self.say(f"run {state}" + (f": {error}" if error else ""))

    def say(self, text: str) -> None:
        """One line into the log, and the record to disk."""
        self.log.parent.mkdir(parents=True, exist_ok=True)
        with self._telling, self.log.open("a") as log:
            log.write(f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} {text}\n")
        self.write()

    def write(self, *, at_most_every: float = 0.0) -> None:
        """Put the record on disk, whole or not at all."""
        with self._telling:
            self.listen(self)
            if time.time() - self._written < at_most_every:
                return
            self._written = time.time()
            aside = self.file.with_suffix(".tmp")
            aside.write_text(json.dumps(self.as_json()))
            aside.replace(self.file)

    def as_json(self) -> dict[str, Any]:
        """Everything but the listener."""
        names = ("id", "actor", "sequence", "flow_run", "state", "started", "ended", "stages", "error")
        told = {name: getattr(self, name) for name in names}
        return told | {"pid": self.owner.pid, "host": self.owner.host, "owner": self.owner.model_dump(mode="json")}


@dataclass(frozen=True)
class StageReport:
    """What a running stage tells about itself."""

    run: RunRecord
    name: str
    entry: dict[str, Any]

    def progress(self, fraction: float, text: str) -> None:
        """How far the stage is, 0 to 1, and with what."""
        self.entry.update(fraction=float(fraction), text=text)
        self.run.write(at_most_every=WRITE_EVERY_S)

    def warn(self, text: str) -> None:
        """Something the user should know that does not stop the stage."""
        self.entry["warnings"].append(text)
        self.run.say(f"{self.name}: warning: {text}")

    def done(self, *, cached: bool, seconds: float) -> None:
        """The stage has its artifact."""
        self.entry.update(state="cached" if cached else "completed", fraction=1.0, text="", seconds=seconds)
        self.run.say(f"{self.name}: " + ("in the store" if cached else f"done in {seconds:.1f} s"))


def list_runs(root: Path) -> list[dict[str, Any]]:
    """All runs of this store, newest first; one whose process is gone without an ending is shown as died, where this machine can tell."""
    found = []
    for file in sorted((root / ".runs").glob("*.json"), reverse=True):
        run = json.loads(file.read_text())
        if run["state"] == "running" and _is_over(run):
            run["state"] = "died"
        found.append(run)
    return found


def find_run(root: Path, run_id: str | None, *, own: bool = False) -> dict[str, Any] | None:
    """The run of this id (or its beginning), or the newest; where `own`, the newest that is not the service's, if there is one."""
    runs = list_runs(root)
    if own and run_id is None:
        runs = [run for run in runs if run.get("flow_run") is None] or runs
    return next((r for r in runs if run_id is None or r["id"].startswith(run_id)), None)


def stop(run: dict[str, Any]) -> None:
    """Ask the process of a run to end. Raises Refused when the run is over, goes on where this machine's process numbers mean nothing, or is
    the service's.
    """
    if run["state"] != "running":
        raise Refused(f"run {run['id']} is not running: it {run['state']}")
    if run.get("flow_run") is not None:
        told = f"cancel {run['actor']} {run['sequence']!r} in the Prefect UI"
        raise Refused(f"run {run['id']} is flow run {run['flow_run']} of the service, which would begin it again: {told}")
    owner = Owner.model_validate(run["owner"])
    if owner.machine != Owner.this_process().machine:
        raise Refused(f"run {run['id']} goes on as process {owner.pid} on {owner.host}: cancel it there")
    os.kill(owner.pid, signal.SIGTERM)


def _is_over(run: dict[str, Any]) -> bool:
    if "owner" not in run:  # a record from before 2026-11-25: its number alone may be anybody's by now
        return True
    owner, here = Owner.model_validate(run["owner"]), Owner.this_process()
    if owner.machine != here.machine:
        return owner.host == here.host  # this machine was started anew since
    return owner.is_dead()
