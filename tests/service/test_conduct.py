"""The parent of a sequence shows what its children are at, while they are at it. Without a server."""

import asyncio
from types import SimpleNamespace

from flows.service import actor
from flows.service.survey import Survey


def test_the_table_follows_a_run_from_stage_to_stage_of_its_pool(monkeypatch):
    looks = iter([Survey({}, {"tracking": {"tracking": "a"}})] * 2 + [Survey({"tracking": None}, {"tracking": {"registration": "b"}})] * 2)
    dispatched, told = [], []
    ended = Survey({"tracking": None, "registration": None}, {})

    async def dispatch(work):
        dispatched.append(work.deployment)
        await asyncio.sleep(0.5)

    async def show(request, found, running, failures):
        told.append(running)

    monkeypatch.setattr(actor, "survey", lambda request, store: next(looks, ended))
    monkeypatch.setattr(actor, "dispatch", dispatch)
    monkeypatch.setattr(actor, "show_stages", show)
    monkeypatch.setattr(actor, "json_settings", lambda settings: {})
    monkeypatch.setattr(actor, "LOOK_EVERY_S", 0.02)
    request = SimpleNamespace(actor="ann", sequence="one", settings=None, until="report")
    asyncio.run(actor.conduct(request, SimpleNamespace(location="store"), "single"))
    assert dispatched == ["tracking/service"]
    assert [running for running in told if running] == [{"tracking"}, {"registration"}]
