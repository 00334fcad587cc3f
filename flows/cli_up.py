"""`physavatar up`: the whole service on this machine, in one command; `worker` and `deploy`: its parts on several."""

import sys
from threading import Thread
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from flows.cli_options import Set
from flows.config import load, places_of
from flows.endings import CANCELLED, Refused


def up(
    *,
    host: str | None = None,
    port: int | None = None,
    demo: Annotated[bool, Parameter(negative="")] = False,
    set_: Set = (),
) -> int:
    """Start server, automations and local workers, print the UI's address, and stay until Ctrl-C.

    Args:
        host: Where the server listens; beyond 127.0.0.1 it asks for a password and needs PostgreSQL.
        port: Its port.
        demo: Hand two small demo actors to the workers, to have something to look at.
    """
    from flows.service.deployments import read
    from flows.service.server import LOOPBACK
    from flows.service.up import stay
    from flows.service.up import up as start

    tell = Console(stderr=True, highlight=False).print
    flags = [f"service.{name}={value}" for name, value in (("host", host), ("port", port)) if value is not None]
    settings = load([*set_, *flags])
    service = settings.service
    try:
        with start(service, read(), tell, places_of(settings)) as supervisor:
            address = (service.url or f"http://{service.host}:{service.port}").removesuffix("/api")
            sys.stdout.write(f"{address}\n")
            sys.stdout.flush()
            if service.host not in LOOPBACK and service.auth is None:
                tell(f"user and password: {supervisor.home / 'auth'}")
            tell(f"running: {', '.join(supervisor.kept)}; logs in {supervisor.home / 'logs'}; Ctrl-C ends everything")
            if demo:
                from flows.service.demonstration import demonstrate

                Thread(target=demonstrate, args=(supervisor.home, tell), daemon=True).start()
            stay(supervisor)
    except KeyboardInterrupt:
        tell("ended")
        return CANCELLED
    return 0


def worker(
    pool: str,
    *,
    limit: int = 1,
    set_: Set = (),
) -> int:
    """Work for one pool of a server elsewhere (service.url), until Ctrl-C.

    Args:
        pool: vision, tracking, simulation, rendering or orchestration.
        limit: How many runs at once.
    """
    from flows.service.parameters import POOLS
    from flows.service.up import stay, work

    if pool not in POOLS:
        raise Refused(f"there is no pool {pool!r}; the pools are {', '.join(POOLS)}")
    tell = Console(stderr=True, highlight=False).print
    settings = load(set_)
    try:
        with work(settings.service, pool, limit, tell, places_of(settings)) as supervisor:
            tell(f"working for {pool}; log in {supervisor.home / 'logs'}")
            stay(supervisor)
    except KeyboardInterrupt:
        tell("ended")
        return CANCELLED
    return 0


def deploy(*, kind: str = "process", set_: Set = ()) -> int:
    """Bring automations, pools and deployments of a server elsewhere (service.url) up to date.

    Args:
        kind: process (workers run flows themselves), docker or kubernetes (a container per flow run).
    """
    from flows.service.deployments import job_variables, read
    from flows.service.up import furnish

    furnish(load(set_).service, read(), kind, job_variables(kind))
    return 0
