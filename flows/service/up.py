"""`physavatar up`: server, automations, pools, deployments and local workers, in this order, until it is told to end."""

import asyncio
import fcntl
import os
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from flows.endings import Refused
from flows.service.database import create_if_missing
from flows.service.parameters import ServiceParameters, home
from flows.service.server import (
    LOOPBACK,
    adopt,
    answers,
    api_url,
    client_environment,
    server_command,
    server_environment,
    wait_for,
    worker_command,
    write_note,
)
from flows.service.supervisor import Supervisor, end_marked

TEND_EVERY_S = 20.0
ELSEWHERE = "start it, or correct service.url"
SECRETS = "PHYSAVATAR_SERVICE__"  # the database's password is the server's business, not the workers'


@contextmanager
def up(service: ServiceParameters, described: dict[str, Any], tell: Callable[[str], None], places: dict[str, str]) -> Iterator[Supervisor]:
    """Everything running, and ended on leaving. With `service.url` only workers are started. Raises Refused, ConnectionRefusedError.

    places: variables for the workers, which run each flow in a folder of its own (`config.places_of`).
    """
    with _alone():
        end_marked(home())
        _refuse_taken_port(service)
        if service.database is not None and service.url is None:
            asyncio.run(create_if_missing(service.database.get_secret_value()))
        environment = {name: value for name, value in os.environ.items() if not name.startswith(("PREFECT_", SECRETS))}
        adopt(client_environment(service))
        supervisor = Supervisor(home(), environment | server_environment(service), tell)
        try:
            if service.url is None:
                supervisor.keep("server", server_command(service))
            _wait(service, supervisor)
            asyncio.run(_furnish(service, described))
            write_note(service)
            supervisor.environment = environment | places | client_environment(service)
            for pool in described["pools"]:
                if (limit := service.workers.get(pool, 0)) > 0:
                    supervisor.keep(pool, worker_command(pool, limit, f"{socket.gethostname()}-{pool}"))
            yield supervisor
        finally:
            supervisor.end()
            (home() / "up.json").unlink(missing_ok=True)


@contextmanager
def work(service: ServiceParameters, pool: str, limit: int, tell: Callable[[str], None], places: dict[str, str]) -> Iterator[Supervisor]:
    """A worker of one pool of a server elsewhere, kept running. Raises ConnectionRefusedError when the server does not answer."""
    with _alone():
        end_marked(home())
        environment = {name: value for name, value in os.environ.items() if not name.startswith(("PREFECT_", SECRETS))}
        adopt(client_environment(service))
        wait_for(api_url(service), ELSEWHERE)
        supervisor = Supervisor(home(), environment | places | client_environment(service), tell)
        try:
            supervisor.keep(pool, worker_command(pool, limit, f"{socket.gethostname()}-{pool}"))
            yield supervisor
        finally:
            supervisor.end()


def furnish(service: ServiceParameters, described: dict[str, Any], kind: str, variables: dict[str, dict[str, Any]]) -> None:
    """Automations, pools of this kind and deployments on a server elsewhere. Raises ConnectionRefusedError."""
    adopt(client_environment(service))
    wait_for(api_url(service), ELSEWHERE)
    asyncio.run(_furnish(service, described, kind, variables))


def stay(supervisor: Supervisor, until: Callable[[], bool] = lambda: False) -> None:
    """Keep all running and tidy up after killed and frozen runs, until interrupted."""
    tended = 0.0
    while not until():
        supervisor.look()
        (supervisor.home / "alive").touch()  # what health checks of containers look at
        if time.monotonic() - tended > TEND_EVERY_S:
            asyncio.run(tend())
            tended = time.monotonic()
        time.sleep(0.5)


async def tend() -> None:
    """End orphans of killed runs on this machine, and engines whose run is long over. A server that is away is asked next time."""
    import httpx
    from prefect.client.orchestration import get_client

    from flows.service.leftovers import end_orphans, end_outlived

    end_orphans()
    try:
        async with get_client() as client:
            await end_outlived(client)
    except httpx.HTTPError:
        return


async def _furnish(
    service: ServiceParameters, described: dict[str, Any], kind: str = "process", variables: dict[str, dict[str, Any]] | None = None
) -> None:
    """Automations before anything could start a run; then what can be run."""
    from prefect.client.orchestration import get_client

    from flows.service.automations import arm
    from flows.service.deployments import deploy, with_parameter

    async with get_client() as client:
        await arm(client, service.notify)
        await deploy(client, with_parameter(described, "helpers", service.helpers), kind=kind, variables=variables or {})


def _wait(service: ServiceParameters, supervisor: Supervisor) -> None:
    if service.url is not None:
        wait_for(service.url, ELSEWHERE)
        return
    server = supervisor.kept["server"]
    wait_for(api_url(service), f"see {server.log}", alive=lambda: server.process.poll() is None)


def _refuse_taken_port(service: ServiceParameters) -> None:
    if service.url is not None:
        return
    if answers(api_url(service)):
        raise Refused(f"a Prefect server already answers at {api_url(service)}: set service.port, or service.url to use that one")
    if service.host not in LOOPBACK and service.database is None:
        raise Refused("a server for other machines needs PostgreSQL: set service.database (SQLite locks up under several workers)")


@contextmanager
def _alone() -> Iterator[None]:
    with (home() / "up.lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise Refused(f"`physavatar up` is already running with {home()}; another PHYSAVATAR_HOME makes another service") from None
        yield
