"""Processes on this machine that outlived the flow run they worked for. Linux; elsewhere none are found.

Every process of a flow run inherits PREFECT__FLOW_RUN_ID. If no engine with that id runs here any more, the process is an orphan: its
run was killed. An engine whose run the server has long declared over (it was frozen, or cut off) has no business either.
"""

import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from uuid import UUID

from prefect.client.orchestration import PrefectClient
from prefect.exceptions import ObjectNotFound

RUN_ID = "PREFECT__FLOW_RUN_ID"
ENGINES = ("prefect.engine\0", "flows.service\0")  # as a command line ends: the plain one in containers per run, ours in process pools
OUTLIVED = timedelta(seconds=60)


@dataclass(frozen=True)
class Process:
    """A process that belongs to a flow run."""

    pid: int
    run: str
    is_engine: bool

    def kill(self) -> None:
        """At once; also when it is stopped."""
        try:
            os.kill(self.pid, signal.SIGKILL)
        except ProcessLookupError:
            return


def end_orphans() -> list[int]:
    """Kill the processes of this user whose flow run is no longer here; their numbers."""
    found = list(processes())
    engines = {process.run for process in found if process.is_engine}
    orphans = [process for process in found if process.run not in engines]
    for process in orphans:
        process.kill()
    return [process.pid for process in orphans]


async def end_outlived(client: PrefectClient) -> list[int]:
    """Kill engines on this machine whose run the server holds for over; their numbers. Their children are orphans then."""
    outlived = []
    for process in [p for p in processes() if p.is_engine]:
        try:
            state = (await client.read_flow_run(UUID(process.run))).state
        except ObjectNotFound:
            continue  # a run of another server
        if state.is_final() and datetime.now(UTC) - state.timestamp > OUTLIVED:
            process.kill()
            outlived.append(process.pid)
    return outlived


def processes() -> Iterator[Process]:
    """This user's processes that belong to flow runs."""
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if entry.stat().st_uid != os.getuid():
                continue
            command = (entry / "cmdline").read_text(errors="replace")
            run = _variable((entry / "environ").read_text(errors="replace"), RUN_ID)
        except OSError:
            continue  # it ended while we looked, or is not ours to see
        if run is not None:
            yield Process(int(entry.name), run, command.endswith(ENGINES))


def _variable(environ: str, name: str) -> str | None:
    return next((entry.partition("=")[2] for entry in environ.split("\0") if entry.startswith(f"{name}=")), None)
