"""A dataset of tiny sequences through the whole service while its parts are killed, frozen and starved; and what is left afterwards."""

import asyncio
import json
import os
import random
import re
import signal
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from prefect.client.orchestration import get_client
from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterState, FlowRunFilterStateType
from prefect.client.schemas.objects import StateType

from flows.service.campaign import FOLDER
from flows.service.dispatch import Work, WorkFailed, dispatch
from flows.service.leftovers import Process, processes
from flows.service.supervisor import MARK, Supervisor
from storage_schemas.store import Store
from tests.service import tiny
from tests.service.place import execute

STAGES = ("capture", "cloth")
KINDS = ("engine", "solver", "worker", "connection", "engine and worker")
FROZEN_S, FULL_S, LIMIT_S = 20.0, 5.0, 1800.0
LIMIT_PER_SEQUENCE_S, PATIENCE_S = 30.0, 60.0
EARLY = 4


@dataclass
class Outcome:
    """What a run under chaos left behind."""

    sequences: int
    completed: int
    failed: dict[str, str]
    lost: list[str]
    kills: Counter
    frozen: int
    disk_full: int
    faults: list[str]
    duplicates: int
    stuck: list[str]
    lock_errors: int
    seconds: float
    server_cpu_s: float


@dataclass
class Chaos:
    """Kills at random moments in a thread of its own, until `kills` were made or it is told to stop.

    With `sequences` the deeds are spread over the run: the n-th waits for its share of them to be in the store, or for a minute.
    """

    supervisor: Supervisor
    store: Path
    database: str | None
    kills: int
    freezes: int
    full_disks: int
    sequences: int = 0
    pause_s: tuple[float, float] = (2.0, 8.0)
    seed: int = 1
    done: Counter = field(default_factory=Counter)
    frozen: int = 0
    full: int = 0
    stopped: threading.Event = field(default_factory=threading.Event)

    def run(self) -> None:
        chance = random.Random(self.seed)
        deeds = [KINDS[n % len(KINDS)] for n in range(self.kills)]
        chance.shuffle(deeds)
        for rare in ["freeze"] * self.freezes + ["disk full"] * self.full_disks:  # early, so that a short run has them too
            deeds.insert(chance.randrange(min(len(deeds), EARLY) + 1), rare)
        many = len(deeds)
        while deeds and not self.stopped.wait(chance.uniform(*self.pause_s)):
            self._await(self.sequences * (many - len(deeds)) / many)
            if self._do(deeds[0], chance):
                deeds.pop(0)
            else:
                deeds.append(deeds.pop(0))  # no such victim just now

    def _do(self, deed: str, chance: random.Random) -> bool:
        own = list(self._own())
        engines, solvers = [p for p in own if p.is_engine], [p for p in own if not p.is_engine]
        workers = [k.process for name, k in self.supervisor.kept.items() if name != "server" and k.process is not None]
        victims = {"engine": engines, "solver": solvers, "worker": workers, "engine and worker": engines, "freeze": workers}
        if deed in victims and not victims[deed]:
            return False
        match deed:
            case "disk full":
                self._fill()
                return True
            case "connection":
                return self._cut_connections()
            case "freeze":
                self._freeze(chance.choice(workers).pid, chance.choice(engines).pid if engines else None)
                return True
            case "engine and worker":
                chance.choice(workers).kill()
        with suppress(ProcessLookupError):
            os.kill(chance.choice(victims[deed]).pid, signal.SIGKILL)
            self.done[deed] += 1
        return True

    def _await(self, finished: float) -> None:
        until = time.monotonic() + PATIENCE_S
        while self._finished() < finished and time.monotonic() < until and not self.stopped.wait(1.0):
            pass

    def _finished(self) -> int:
        return sum(1 for _ in self.store.glob(f"*/*/{STAGES[-1]}/*/manifest.json"))

    def _own(self) -> Iterator[Process]:
        for process in processes():
            with suppress(OSError):
                if f"{MARK}={self.supervisor.home}\0" in Path(f"/proc/{process.pid}/environ").read_text(errors="replace"):
                    yield process

    def _cut_connections(self) -> bool:
        if self.database is None:
            return False
        cut = f"SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = '{self.database}'"
        self.done["connection"] += asyncio.run(execute(cut))
        return True

    def _freeze(self, worker: int, engine: int | None) -> None:
        """A worker for a while, an engine for ever."""
        with suppress(ProcessLookupError):
            if engine is not None:
                os.kill(engine, signal.SIGSTOP)
            os.kill(worker, signal.SIGSTOP)
            self.stopped.wait(FROZEN_S)
            os.kill(worker, signal.SIGCONT)
            self.frozen += 1

    def _fill(self) -> None:
        hog = self.store / ".hog"
        with suppress(OSError), hog.open("wb") as file:
            while True:
                file.write(bytes(1 << 16))
                file.flush()
        self.stopped.wait(FULL_S)
        hog.unlink()
        self.full += 1


@contextmanager
def small_disk(folder: Path, megabytes: int) -> Iterator[bool]:
    """`folder` on a file system of this size, where we may mount one; whether we may."""
    folder.mkdir(exist_ok=True)
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", folder], capture_output=True, check=False)
    try:
        yield mounted.returncode == 0
    finally:
        if mounted.returncode == 0:
            subprocess.run(["umount", "-l", folder], check=True)


def endure(
    place: Path, supervisor: Supervisor, *, sequences: int, chaos: Callable[[str | None], Chaos] | None, database: str | None
) -> Outcome:
    """Run a dataset to its end, with or without chaos, and look at what is left."""
    data, store = place / "data", place / "store"
    chance = random.Random(0)
    for n in range(sequences):
        tiny.recording(data, f"actor{n % 7}", f"take{n:04d}", f"{chance.uniform(0.05, 0.05 if chaos is None else 4.0):.2f}")
    before, start = _cpu_seconds(supervisor), time.monotonic()
    trouble = chaos(database) if chaos else None
    thread = threading.Thread(target=trouble.run) if trouble else None
    if thread:
        thread.start()
    try:
        with suppress(WorkFailed, TimeoutError):  # what is late is told as what it is: neither complete nor failed
            limit_s = max(LIMIT_S, LIMIT_PER_SEQUENCE_S * sequences)
            asyncio.run(asyncio.wait_for(dispatch(Work("dataset/service", {}, f"chaos-{place.name}", "dataset")), limit_s))
    finally:
        if trouble and thread:
            trouble.stopped.set()
            thread.join()
    seconds = time.monotonic() - start
    stuck = asyncio.run(_stuck(limit_s=300.0))
    opened = Store(store)
    found = Counter((e.address.actor, e.address.sequence, e.address.stage) for e in opened.list())
    wanted = [(f"actor{n % 7}", f"take{n:04d}") for n in range(sequences)]
    complete = {at for at in wanted if all(found[(*at, stage)] for stage in STAGES)}
    failed = _reasons(store)
    return Outcome(
        sequences=sequences,
        completed=len(complete),
        failed={f"{a} {s}": failed[a, s] for a, s in wanted if (a, s) not in complete and (a, s) in failed},
        lost=[f"{a} {s}" for a, s in wanted if (a, s) not in complete and not failed.get((a, s))],
        kills=trouble.done if trouble else Counter(),
        frozen=trouble.frozen if trouble else 0,
        disk_full=trouble.full if trouble else 0,
        faults=[str(fault) for fault in opened.verify()],
        duplicates=sum(count > 1 for count in found.values()),
        stuck=stuck,
        lock_errors=_lock_errors(supervisor.home),
        seconds=seconds,
        server_cpu_s=_cpu_seconds(supervisor) - before,
    )


def _reasons(store: Path) -> dict[tuple[str, str], str]:
    files = sorted((store / FOLDER).glob("*.json"))
    rows = [row for file in files for row in json.loads(file.read_text())["rows"]]
    return {(row["actor"], row["sequence"]): row["why"] for row in rows if row["state"] == "failed"}


async def _stuck(limit_s: float) -> list[str]:
    """Runs that are still Running, Pending or Cancelling `limit_s` after everything should have ended (sweepers come and go)."""
    types = [StateType.RUNNING, StateType.PENDING, StateType.CANCELLING]
    until, left = time.monotonic() + limit_s, []
    async with get_client() as client:
        while time.monotonic() < until:
            wanted = FlowRunFilter(state=FlowRunFilterState(type=FlowRunFilterStateType(any_=types)))
            sweeper = (await client.read_flow_by_name("sweeper")).id
            left = [r.name for r in await client.read_flow_runs(flow_run_filter=wanted) if r.flow_id != sweeper]
            if not left:
                break
            await asyncio.sleep(2.0)
    return left


def _lock_errors(home: Path) -> int:
    return sum(
        len(re.findall("database is locked|deadlock detected", log.read_text(errors="replace"))) for log in (home / "logs").glob("*.log")
    )


def _cpu_seconds(supervisor: Supervisor) -> float:
    """User and system time of the server's process, its ended children included."""
    process = supervisor.kept["server"].process
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(") ")[2].split()
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")
