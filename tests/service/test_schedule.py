"""What a schedule starts has no settings of its own: the flow finds the submitter's, in a folder that is not theirs. And it stays switched as it was."""

import asyncio
import json
import os
import sys
from pathlib import Path

import pytest
from prefect.client.orchestration import get_client

from flows.config import load, places_of
from flows.service.deployments import deploy
from flows.service.supervisor import Supervisor
from tests.service.place import ROOT

SHOW = """
import json, os, sys
from pathlib import Path
os.chdir(sys.argv[1])
from flows.config import load
found = load()
shown = [str(found.store), str(found.data), str(found.body.model), str(found.keypoints.model), found.cloth.density]
Path(sys.argv[2]).write_text(json.dumps(shown))
"""
NIGHTLY = {
    "name": "nightly",
    "entrypoint": "tests.service.tiny.dataset",
    "work_pool": {"name": "idle", "work_queue_name": "single"},
    "schedules": [{"cron": "0 2 * * *", "timezone": "UTC", "active": False}, {"interval": 86400, "active": True}],
}


@pytest.fixture
def project(tmp_path, monkeypatch):
    for name in [name for name in os.environ if name.startswith("PHYSAVATAR_")]:
        monkeypatch.delenv(name)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "physavatar.toml").write_text('store = "kept"\n[body]\nmodel = "people/ann.npz"\n[cloth]\ndensity = 321.0\n')
    return tmp_path


def seen_by_a_flow(place: Path, environment: dict[str, str]) -> list:
    """What `load` finds in a process that a worker of `physavatar up` starts, in a folder of its own."""
    (place / "elsewhere").mkdir()
    supervisor = Supervisor(place / "home", {**os.environ, "PYTHONPATH": str(ROOT), **environment})
    supervisor.home.mkdir()
    supervisor.keep("flow", [sys.executable, "-c", SHOW, str(place / "elsewhere"), str(place / "seen")])
    supervisor.kept["flow"].process.wait()
    assert (place / "seen").exists(), supervisor.kept["flow"].log.read_text()
    return json.loads((place / "seen").read_text())


def test_a_flow_without_settings_finds_those_of_the_folder_where_its_worker_was_started(project):
    settings = load()
    expected = [str(project / "kept"), str(project / "data"), str(project / "people/ann.npz"), str(settings.keypoints.model), 321.0]
    assert seen_by_a_flow(project, places_of(settings)) == expected


def test_flags_and_a_store_that_is_no_folder_travel_too(project):
    settings = load(["store=s3://bucket/own", "data=other"])
    assert seen_by_a_flow(project, places_of(settings))[:2] == ["s3://bucket/own", str(project / "other")]


@pytest.mark.parametrize(("kind", "at_first"), [("cron", False), ("interval", True)])
def test_a_schedule_stays_as_somebody_switched_it(running, kind, at_first):
    async def deployed(client):
        await deploy(client, {"pools": {}, "deployments": [NIGHTLY]}, kind="process", variables={})
        known = await client.read_deployment_by_name("dataset/nightly")
        return known, next(schedule for schedule in known.schedules if hasattr(schedule.schedule, kind))

    async def go() -> list[bool]:
        async with get_client() as client:
            known, schedule = await deployed(client)
            await client.update_deployment_schedule(known.id, schedule.id, active=not at_first)
            _, again = await deployed(client)
            await client.delete_deployment(known.id)
            return [schedule.active, again.active]

    assert asyncio.run(go()) == [at_first, not at_first]
