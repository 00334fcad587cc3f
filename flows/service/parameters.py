"""What an operator can set about the service: [service] in physavatar.toml, or PHYSAVATAR_SERVICE__… in the environment."""

import os
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, SecretStr, field_validator

from tasks.stage import Parameters, Positive

POOLS = ("vision", "tracking", "simulation", "rendering", "orchestration")


def _set(given: Any) -> Any:
    """A variable that a shell or a compose file leaves empty is not set."""
    return None if given in ("", SecretStr("")) else given


Text = Annotated[str | None, BeforeValidator(_set)]
Secret = Annotated[SecretStr | None, BeforeValidator(_set)]


class ServiceParameters(Parameters):
    """host, port: where the server listens; url: a server elsewhere (then `up` starts workers only); database: SQLAlchemy URL of
    PostgreSQL (else SQLite in the home folder); auth: `user:password` of the server; workers: pool → how many runs at once on this
    machine; notify: Apprise URL told of failures; helpers: how many other workers of the simulation pool may join in one sequence's
    simulations (they need the store's folder). Secrets are shown nowhere."""

    host: str = "127.0.0.1"
    port: int = Field(default=4200, ge=1, le=65535)
    url: Text = None
    database: Secret = None
    auth: Secret = None
    notify: Secret = None
    workers: dict[str, Annotated[int, Field(ge=0)]] = Field(default_factory=lambda: dict.fromkeys(POOLS[:-1], 1) | {"orchestration": 16})
    poll_s: Positive = 2.0
    helpers: int = Field(default=0, ge=0)

    @field_validator("workers")
    @classmethod
    def _work_for_pools(cls, workers: dict[str, int]) -> dict[str, int]:
        if unknown := sorted(workers.keys() - set(POOLS)):
            raise ValueError(f"there is no pool {unknown[0]!r}; the pools are {', '.join(POOLS)}")
        return workers


def home() -> Path:
    """The service's own folder on this machine (PHYSAVATAR_HOME, default ~/.physavatar): Prefect's home, passwords, who runs."""
    folder = Path(os.environ.get("PHYSAVATAR_HOME", "~/.physavatar")).expanduser()
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    return folder
