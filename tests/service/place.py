"""A whole service for tests: real server, PostgreSQL where there is one (else SQLite), workers, the tiny line; on a free port, ended after."""

import asyncio
import os
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import asyncpg
import pytest

from flows.service.deployments import read
from flows.service.parameters import ServiceParameters
from flows.service.server import adopt, worker_command
from flows.service.supervisor import Supervisor
from flows.service.up import stay, up
from tests.service import tiny

POSTGRES = os.environ.get("PHYSAVATAR_TEST_POSTGRES", "postgresql://postgres@127.0.0.1:5432")
ROOT = Path(__file__).parents[2]


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


async def execute(statement: str) -> bool:
    """Whether there is a PostgreSQL that did it."""
    try:
        connection = await asyncpg.connect(f"{POSTGRES}/postgres", timeout=5)
    except (OSError, asyncpg.PostgresError):
        return False
    try:
        await connection.execute(statement)
    finally:
        await connection.close()
    return True


@contextmanager
def database(name: str) -> Iterator[str | None]:
    """A database of this name, dropped at the end; None where there is no PostgreSQL."""
    there = asyncio.run(execute(f'DROP DATABASE IF EXISTS "{name}" WITH (FORCE)')) and asyncio.run(execute(f'CREATE DATABASE "{name}"'))
    try:
        yield f"{POSTGRES.replace('postgresql://', 'postgresql+asyncpg://')}/{name}" if there else None
    finally:
        if there:
            asyncio.run(execute(f'DROP DATABASE IF EXISTS "{name}" WITH (FORCE)'))


@contextmanager
def service(place: Path, *, workers: dict[str, int] | None = None, **more: Any) -> Iterator[Supervisor]:
    """Running below `place`; TINY_STORE and TINY_DATA point there."""
    port = free_port()
    with pytest.MonkeyPatch.context() as patch, database(f"physavatar_test_{port}") as url:
        patch.setenv("PHYSAVATAR_HOME", str(place / "home"))
        patch.setenv("PHYSAVATAR_CACHE", str(place / "cache"))
        patch.setenv("PYTHONPATH", str(ROOT))
        patch.setenv("TINY_STORE", str(place / "store"))
        patch.setenv("TINY_DATA", str(place / "data"))
        (place / "data").mkdir(exist_ok=True)
        for name in [name for name in os.environ if name.startswith("PREFECT_")]:
            patch.delenv(name)
        limits = workers or {"vision": 3, "simulation": 3, "orchestration": 16}
        parameters = ServiceParameters(port=port, database=url, workers=limits, poll_s=1.0, **more)
        before = dict(os.environ)
        ended = threading.Event()
        with up(parameters, read(Path(__file__).with_name("tiny.yaml")), print, {}) as supervisor:
            keeper = threading.Thread(target=stay, args=(supervisor, ended.is_set))
            keeper.start()
            supervisor.database = f"physavatar_test_{port}" if url else None
            try:
                yield supervisor
            finally:
                ended.set()
                keeper.join()
        for name in os.environ.keys() - before.keys():
            del os.environ[name]
        adopt({})


def fourth_worker(supervisor: Supervisor) -> None:
    """Another worker in the simulation pool, as a second machine would be."""
    supervisor.keep("simulation again", worker_command("simulation", 3, "another-simulation"))


def order(actor: str, sequence: str) -> dict[str, Any]:
    """The parameters of an actor's flow run."""
    settings = tiny.load().model_dump(mode="json", exclude={"dataset"})
    settings["capture"] = {"recording": str(Path(os.environ["TINY_DATA"]) / actor / sequence)}
    return {"actor": actor, "sequence": sequence, "settings": settings, "until": "cloth"}
