"""A run without a server speaks to none, whatever the user's environment knows of."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ASK = """
import sys
from pathlib import Path
from flows.actor import use_local_prefect
use_local_prefect(Path(sys.argv[1]))
from prefect.settings import get_current_settings
settings = get_current_settings()
print(settings.api.url or "none", settings.home, settings.server.database.connection_url.get_secret_value())
"""
SERVER, DATABASE = "http://192.0.2.1:4200/api", "postgresql+asyncpg://somebody@192.0.2.1/prefect"


def by_environment(place: Path) -> dict[str, str]:
    return {"PREFECT_API_URL": SERVER, "PREFECT_SERVER_DATABASE_CONNECTION_URL": DATABASE}


def by_profile(place: Path) -> dict[str, str]:
    (place / "home").mkdir()
    (place / "home/profiles.toml").write_text(f'active = "work"\n[profiles.work]\nPREFECT_API_URL = "{SERVER}"\n')
    return {"PREFECT_HOME": str(place / "home")}


@pytest.mark.parametrize("named", [by_environment, by_profile])
def test_another_prefect_that_is_named_is_not_used(tmp_path, named):
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **named(tmp_path)}
    told = subprocess.check_output([sys.executable, "-c", ASK, "store"], cwd=tmp_path, env=environment, text=True)
    home = tmp_path / "store/.prefect"
    assert told.split() == ["none", str(home), f"sqlite+aiosqlite:///{home}/prefect.db"]
