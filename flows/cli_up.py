"""`physavatar up`: the whole service on this machine, in one command."""

import sys
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from flows.config import load
from flows.endings import CANCELLED


def up(
    *,
    host: str | None = None,
    port: int | None = None,
    set_: Annotated[tuple[str, ...], Parameter(name="--set", negative="")] = (),
) -> int:
    """Start server, automations and local workers, print the UI's address, and stay until Ctrl-C.

    Parameters
    ----------
    host: Where the server listens; beyond 127.0.0.1 it asks for a password and needs PostgreSQL.
    port: Its port.
    """
    from flows.service.deployments import read
    from flows.service.server import LOOPBACK
    from flows.service.up import stay
    from flows.service.up import up as start

    tell = Console(stderr=True, highlight=False).print
    flags = [f"service.{name}={value}" for name, value in (("host", host), ("port", port)) if value is not None]
    service = load([*set_, *flags]).service
    try:
        with start(service, read(), tell) as supervisor:
            address = (service.url or f"http://{service.host}:{service.port}").removesuffix("/api")
            sys.stdout.write(f"{address}\n")
            sys.stdout.flush()
            if service.host not in LOOPBACK and service.auth is None:
                tell(f"user and password: {supervisor.home / 'auth'}")
            tell(f"running: {', '.join(supervisor.kept)}; logs in {supervisor.home / 'logs'}; Ctrl-C ends everything")
            stay(supervisor)
    except KeyboardInterrupt:
        tell("ended")
        return CANCELLED
    return 0
