"""The service examined: server, database, automations, pools and workers. Without a server there is nothing to examine."""

import asyncio
import json
import os
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from typing import Any

from flows.service.parameters import ServiceParameters, home
from flows.service.server import adopt, answers, api_url, running_environment

WORKER_S = 90.0


def url_of(service: ServiceParameters) -> str | None:
    """Where a server should be: the one that is set, or the one of which `physavatar up` left word."""
    note = home() / "up.json"
    return service.url or (json.loads(note.read_text())["url"] if note.exists() else None)


def server(service: ServiceParameters, url: str) -> Iterator[str]:
    """It answers."""
    if not answers(url):
        raise ConnectionError(f"nothing answers at {url}")
    adopt(running_environment(service))
    yield f"{url} {asyncio.run(_asked(_version))}"


def database(service: ServiceParameters) -> Iterator[str]:
    """What kind the server is told to use."""
    if service.database is None:
        yield "SQLite: for one person on one machine; it locks up under several workers"
        return
    kind = service.database.get_secret_value().partition("://")[0]
    asyncio.run(_connect(service.database.get_secret_value()))
    yield f"{kind} answers"


def automations(service: ServiceParameters) -> Iterator[str]:
    """Zombies would be noticed."""
    from flows.service.automations import SILENCE_S, armed

    if not asyncio.run(_asked(armed)):
        raise LookupError("the zombie automation is missing or switched off: killed runs would stay Running for ever")
    yield f"runs silent for {SILENCE_S} s are declared crashed"


def pools(service: ServiceParameters) -> Iterator[str]:
    """Every pool of deploy/prefect.yaml exists and somebody works there."""
    from flows.service.deployments import read

    idle = []
    for name in read()["pools"]:
        workers = asyncio.run(_asked(lambda client, name=name: client.read_workers_for_work_pool(name)))
        live = [w for w in workers if w.last_heartbeat_time and (datetime.now(UTC) - w.last_heartbeat_time).total_seconds() < WORKER_S]
        if not live:
            idle.append(name)
        yield f"{name}: {len(live)} worker{'s' * (len(live) != 1)}"
    if idle:
        raise LookupError(f"nobody works in {', '.join(idle)}")


def pickles() -> Iterator[str]:
    """Results are JSON: what a pickle in shared storage could do is run."""
    serializer = os.environ.get("PREFECT_RESULTS_DEFAULT_SERIALIZER", "json")
    if serializer != "json":
        raise ValueError(f"PREFECT_RESULTS_DEFAULT_SERIALIZER={serializer}")
    yield "results are JSON"


def checks(service: ServiceParameters) -> Iterator[tuple[str, Callable[[], Iterator[str]], str]]:
    """Name, check and remedy, in the order in which to mend them."""
    yield "results", pickles, "unset PREFECT_RESULTS_DEFAULT_SERIALIZER"
    url = url_of(service)
    if url is None:
        yield "server", lambda: iter([f"none at {api_url(service)}: everything runs in one process"]), ""
        return
    yield "server", lambda: server(service, url), "physavatar up, or set service.url"
    if not answers(url):
        return
    yield "database", lambda: database(service), "start PostgreSQL, or correct service.database"
    yield "automations", lambda: automations(service), "physavatar up creates it"
    yield "pools and workers", lambda: pools(service), "physavatar up, or start workers (deploy/README.md)"


async def _asked(question: Callable[[Any], Any]) -> Any:
    from prefect.client.orchestration import get_client

    async with get_client() as client:
        return await question(client)


async def _version(client: Any) -> str:
    return f"prefect {await client.api_version()}"


async def _connect(url: str) -> None:
    from sqlalchemy.ext.asyncio import create_async_engine

    engine = create_async_engine(url)
    try:
        async with engine.connect():
            return
    finally:
        await engine.dispose()
