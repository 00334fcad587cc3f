"""The service: what dispatch costs, planning a large dataset, throughput, chaos, races and malformed inputs.

    python -m tests.benchmarks.service    QUICK=1: a tenth    FULL=1: 100 kills    JSON=1: JSON on stdout    ONLY=word: rows whose part contains it
                                          SEQUENCES=40 KILLS=12: so many instead of 200 and 30

Needs PostgreSQL (PHYSAVATAR_TEST_POSTGRES, default postgresql://postgres@127.0.0.1:5432), else SQLite is used and the table says so. The
sequences are those of the tiny line (tests/service/tiny.py): two stages on two pools whose science takes 50 ms, so that what is measured
is the service. Two cores are kept busy by it; its figures mean little beside other work.
"""

import asyncio
import multiprocessing
import os
import resource
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median

from tests.benchmarks.table import Row, chosen, show

QUICK, FULL = bool(os.environ.get("QUICK")), bool(os.environ.get("FULL"))


def tenth(n: int) -> int:
    return max(1, n // 10) if QUICK else n


def sequences() -> int:
    """How many go through the service."""
    return int(os.environ.get("SEQUENCES", tenth(200)))


def planning() -> Iterator[Row]:
    """Finished sequences of the avatar's line: the first look (every manifest and file size) and later ones (marks)."""
    n = tenth(10_000)
    cost = {}
    for count in (n // 10, n):
        context = multiprocessing.get_context("spawn")
        with context.Pool(1) as pool:
            cost[count] = pool.apply(_plan, (count,))
    looks, megabytes = cost[n]
    for name, (seconds, processor) in zip(("first look", "marks in place"), looks):
        yield f"plan: {n} finished sequences, {name}, s", seconds, f"<= {60 * n / 10_000:g}", seconds <= 60 * n / 10_000
        yield f"plan: {n} finished sequences, {name}, processor s", processor, "stated", None
    yield "plan: peak memory, MB", megabytes, "<= 500", megabytes <= 500
    growth = (looks[1][1] / n) / (cost[n // 10][0][1][1] / (n // 10))
    yield "plan: processor time per sequence at ten times as many, ratio", growth, "<= 1.3", growth <= 1.3


def _plan(n: int) -> tuple[list[tuple[float, float]], float]:
    """(seconds, processor seconds) of the first and of a later plan over n finished sequences; peak memory in MB of the planning process."""
    from flows.dataset import counts, find_sequences, plan_dataset
    from storage_schemas.store import Store
    from tests.service.finished import finished_sequences

    place = Path(tempfile.mkdtemp(prefix="physavatar-plan-"))
    os.environ["PHYSAVATAR_CACHE"] = str(place / "cache")
    try:
        service, settings = finished_sequences(place, n)
        store = Store(settings.store)
        seconds = []
        for _ in range(2):
            start, busy = time.perf_counter(), time.process_time()
            found = counts(plan_dataset(find_sequences(settings.data), lambda at: service.request(at, settings, store), store))
            seconds.append((time.perf_counter() - start, time.process_time() - busy))
            assert found == {"finished": n}, found
        return seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    finally:
        shutil.rmtree(place)


def in_process() -> Iterator[Row]:
    """What a stage costs beyond its own seconds when the flow runs here, without a server."""
    from tests.service.alone import overhead_alone

    seconds = overhead_alone(10)
    yield "one process: overhead per stage, s", seconds, "<= 0.5", seconds <= 0.5


def dispatching() -> Iterator[Row]:
    """From asking to the completed child, less the stage's own time; one run at a time, warm workers."""
    from flows.service.dispatch import Work, dispatch
    from tests.service import tiny
    from tests.service.place import order, service

    with _place() as place, service(place):
        took = []
        for n in range(tenth(20) + 1):
            tiny.recording(place / "data", "ann", f"take{n}")
            start = time.perf_counter()
            asyncio.run(dispatch(Work("vision/service", order("ann", f"take{n}"), f"bench-{n}", f"ann take{n}: capture")))
            took.append(time.perf_counter() - start - 0.05)
    typical = median(took[1:])
    yield "dispatch: overhead per stage, warm worker, s", typical, "<= 8", typical <= 8


def throughput() -> Iterator[Row]:
    """A dataset through server, database and four workers, undisturbed."""
    from tests.service.chaos import endure
    from tests.service.place import fourth_worker, service

    n = sequences()
    with _place() as place, service(place) as supervisor:
        fourth_worker(supervisor)
        outcome = endure(place, supervisor, sequences=n, chaos=None, database=supervisor.database)
        kind = "PostgreSQL" if supervisor.database else "SQLite"
    yield f"throughput ({kind}): completed of {n} sequences", outcome.completed, str(n), outcome.completed == n
    yield "throughput: sequences per minute", 60 * n / outcome.seconds, "stated", None
    yield "throughput: CPU of the server per sequence, s", outcome.server_cpu_s / n, "stated", None
    yield "throughput: lock errors in the logs", outcome.lock_errors, "0", outcome.lock_errors == 0


def chaos() -> Iterator[Row]:
    """The same dataset while it is killed at."""
    from tests.service.chaos import Chaos, endure, small_disk
    from tests.service.place import fourth_worker, service

    n, kills = sequences(), int(os.environ.get("KILLS", 100 if FULL else tenth(30)))
    with _place() as place, small_disk(place / "store", 64 + n) as mounted, service(place) as supervisor:
        fourth_worker(supervisor)

        def trouble(database: str | None) -> Chaos:
            return Chaos(supervisor, place / "store", database, kills, 1, 2 * int(mounted), n)

        outcome = endure(place, supervisor, sequences=n, chaos=trouble, database=supervisor.database)
    total = sum(outcome.kills.values())
    told = ", ".join(f"{count} {kind}" for kind, count in outcome.kills.items())
    yield f"chaos: kills ({told})", total, f">= {kills}", total >= kills
    yield "chaos: workers frozen for a while", outcome.frozen, "1", outcome.frozen == 1
    yield "chaos: disk full" + ("" if mounted else " (no right to mount a small disk)"), outcome.disk_full, "2", outcome.disk_full == 2
    yield f"chaos: completed of {n} sequences", outcome.completed, "stated", None
    yield "chaos: failed with a reason", len(outcome.failed), "stated", None
    yield "chaos: neither", len(outcome.lost), "0", not outcome.lost
    yield "chaos: faults found by verify", len(outcome.faults), "0", not outcome.faults
    yield "chaos: duplicate artifacts", outcome.duplicates, "0", outcome.duplicates == 0
    yield "chaos: runs still Running five minutes later", len(outcome.stuck), "0", not outcome.stuck
    yield "chaos: seconds", outcome.seconds, "stated", None


def races() -> Iterator[Row]:
    """Two processes ask for one key at the same moment."""
    from tests.service.races import race

    n = tenth(50)
    with _place() as place:
        artifacts, computed = race(place, n)
    yield f"two submits of one key, {n} times: artifacts", artifacts, str(n), artifacts == n
    yield f"two submits of one key, {n} times: computed", computed, str(n), computed == n


def malformed() -> Iterator[Row]:
    """Each reader over 30 damaged files, in a child process with a limit on time and memory."""
    from tests.service.malformed import READERS, endings

    n = max(5, tenth(30))
    for name in READERS:
        found = endings(name, n)
        clear = found["refused"] + found["read"]
        said = ", ".join(f"{count} {ending}" for ending, count in found.items())
        yield f"malformed {name}: clear endings of {n} ({said})", clear, str(n), clear == n


class _place:
    """A folder for one part, removed after it."""

    def __enter__(self) -> Path:
        self.path = Path(tempfile.mkdtemp(prefix="physavatar-service-"))
        return self.path

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self.path, ignore_errors=True)


PARTS: dict[str, Callable[[], Iterator[Row]]] = {
    "planning": planning,
    "in process": in_process,
    "races": races,
    "malformed": malformed,
    "dispatching": dispatching,
    "throughput": throughput,
    "chaos": chaos,
}


def main() -> None:
    """Print the table."""
    show(chosen(PARTS))


if __name__ == "__main__":
    main()
