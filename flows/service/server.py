"""Where the Prefect server is and how to speak to it; the environment of server and workers."""

import json
import os
import secrets
import sys
import time
from collections.abc import Callable
from pathlib import Path

import httpx

from flows.endings import Refused
from flows.service.automations import HEARTBEAT_S
from flows.service.parameters import ServiceParameters, home

LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
START_S = 180.0


def api_url(service: ServiceParameters) -> str:
    """The API of the server that this configuration means."""
    return service.url or f"http://{service.host if service.host != '0.0.0.0' else '127.0.0.1'}:{service.port}/api"


def credential(service: ServiceParameters) -> str | None:
    """`user:password` of the server. One of ours that listens beyond loopback has one: if none is set, it is made up and kept in the home
    folder.

    Raises Refused for one of those whose credential is no user and password.
    """
    beyond = service.url is None and service.host not in LOOPBACK
    if service.auth is not None:
        given = service.auth.get_secret_value()
        if beyond and not all(given.partition(":")):
            raise Refused(f"service.auth is not user:password, and {service.host} is open to others: correct it, or leave it out")
        return given
    if service.url is not None:
        return None  # what this machine made up is for its own server
    kept = home() / "auth"
    known = kept.read_text().strip() if kept.exists() else ""
    return known or (_made_up(kept) if beyond else None)


def _made_up(kept: Path) -> str:
    made_up, aside = f"physavatar:{secrets.token_urlsafe(24)}", kept.with_name(f"auth.{os.getpid()}")
    with open(os.open(aside, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w") as file:  # noqa: PTH123  the mode from the start
        file.write(made_up)
    aside.replace(kept)
    return made_up


def client_environment(service: ServiceParameters) -> dict[str, str]:
    """What a process needs to be a client or a worker of the server. Results are JSON; nothing is sent elsewhere."""
    auth = credential(service)
    return {
        "PREFECT_API_URL": api_url(service),
        "PATH": f"{Path(sys.executable).parent}:{os.environ.get('PATH', os.defpath)}",
        **({"PREFECT_API_AUTH_STRING": auth} if auth else {}),
        "PREFECT_HOME": str(home() / "prefect"),
        "PREFECT_FLOWS_HEARTBEAT_FREQUENCY": str(HEARTBEAT_S),
        "PREFECT_WORKER_QUERY_SECONDS": str(service.poll_s),
        "PREFECT_RESULTS_DEFAULT_SERIALIZER": "json",
        "PREFECT_SERVER_ALLOW_EPHEMERAL_MODE": "false",
        "PREFECT_CLIENT_MAX_RETRIES": "8",
        "PREFECT_CLIENT_RETRY_EXTRA_CODES": "500,504",  # a database connection that broke
        "DO_NOT_TRACK": "1",
    }


def server_environment(service: ServiceParameters) -> dict[str, str]:
    """What the server needs besides."""
    auth = credential(service)
    return {
        "PREFECT_HOME": str(home() / "prefect"),
        **({"PREFECT_SERVER_DATABASE_CONNECTION_URL": service.database.get_secret_value()} if service.database else {}),
        **({"PREFECT_SERVER_API_AUTH_STRING": auth} if auth else {}),
        "PREFECT_SERVER_API_CSRF_PROTECTION_ENABLED": "true",
        "PREFECT_SERVER_UI_API_URL": "/api",  # where the browser found the page; by default it looks at port 4200 of its own machine
        "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
        "PREFECT_SERVER_SERVICES_DB_VACUUM_ENABLED": "true",
        "DO_NOT_TRACK": "1",
    }


def server_command(service: ServiceParameters) -> list[str]:
    """Starts the server."""
    return [sys.executable, "-m", "prefect", "server", "start", "--host", service.host, "--port", str(service.port)]


def worker_command(pool: str, limit: int, name: str) -> list[str]:
    """Starts a worker of a process pool, with `limit` runs at once."""
    return [
        *(sys.executable, "-m", "prefect", "worker", "start", "--pool", pool, "--type", "process"),
        *("--name", name, "--limit", str(limit), "--install-policy", "never"),
    ]


def wait_for(url: str, otherwise: str, *, seconds: float = START_S, alive: Callable[[], bool] = lambda: True) -> None:
    """Until the server answers. Raises ConnectionRefusedError with what to look at."""
    until = time.monotonic() + seconds
    while time.monotonic() < until and alive():
        if answers(url):
            return
        time.sleep(0.3)
    raise ConnectionRefusedError(f"nothing answers at {url}: {otherwise}")


def answers(url: str) -> bool:
    """Whether a server is there and well."""
    try:
        return httpx.get(f"{url}/health", timeout=3.0).status_code == httpx.codes.OK
    except httpx.HTTPError:
        return False


def speak_to_server(service: ServiceParameters) -> None:
    """Make this process a client: of the server set, or of the one that `physavatar up` runs on this machine. Raises ConnectionRefusedError."""
    adopt(running_environment(service))
    if not answers(os.environ["PREFECT_API_URL"]):
        raise ConnectionRefusedError(f"no Prefect server answers at {os.environ['PREFECT_API_URL']}: start one with `physavatar up`")


def running_environment(service: ServiceParameters) -> dict[str, str]:
    """`client_environment` for the server set, or for the one of which `physavatar up` left word on this machine."""
    note = home() / "up.json"
    if service.url is not None or not note.exists():
        return client_environment(service)
    running = json.loads(note.read_text())
    meant = service if running["own"] else service.model_copy(update={"url": running["url"]})
    return client_environment(meant) | {"PREFECT_API_URL": running["url"]}


def adopt(environment: dict[str, str]) -> None:
    """Set variables for this process, and for Prefect also where it has read them already."""
    os.environ.update(environment)
    if "prefect" in sys.modules:
        from prefect.context import refresh_global_settings_context

        refresh_global_settings_context()


def write_note(service: ServiceParameters) -> None:
    """Leave word where the server is that this machine's workers serve, and whether it is this machine's own."""
    (home() / "up.json").write_text(json.dumps({"url": api_url(service), "own": service.url is None, "pid": os.getpid()}))
