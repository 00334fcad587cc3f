"""The parent of a sequence shows what its children are at, while they are at it, and all end as what they waited for. Without a server."""

import asyncio
import json
from dataclasses import replace
from types import SimpleNamespace

import pytest
from prefect.client.schemas.objects import StateType

from flows.preflight import preflight
from flows.service import actor, deployed, group
from flows.service.dispatch import WorkFailed
from flows.service.survey import Survey
from storage_schemas.store import Store
from tasks.child_process import ChildTimedOut
from tasks.geometry.faults import BadInput, Fault
from tests.service import tiny
from tests.service.place import order


@pytest.fixture
def ordered(tmp_path, monkeypatch):
    monkeypatch.setenv("TINY_STORE", str(tmp_path / "store"))
    monkeypatch.setenv("TINY_DATA", str(tmp_path / "data"))
    tiny.recording(tmp_path / "data", "ann", "one")
    return order("ann", "one")


def failing(error: Exception):
    async def fail(*_):
        raise error

    return fail


@pytest.mark.parametrize(
    ("ending", "type_"), [("Cancelled", StateType.CANCELLED), ("TimedOut", StateType.FAILED), ("Failed", StateType.FAILED)]
)
def test_the_parent_ends_as_its_child_did(ordered, monkeypatch, ending, type_):
    monkeypatch.setattr(actor, "dispatch", failing(WorkFailed("ann one: why", ending)))
    monkeypatch.setattr(actor, "show_stages", shown)
    parent = tiny.actor.fn(**ordered)
    if ending == "Failed":
        with pytest.raises(WorkFailed, match="ann one: why"):
            asyncio.run(parent)
    else:
        state = asyncio.run(parent)
        assert (state.type, state.name, state.message) == (type_, ending, "ann one: why")


def test_what_can_be_found_wrong_is_before_anything_is_dispatched(ordered, monkeypatch):
    """A camera that cannot be drawn had been told after hours: appearance comes last."""

    def check(settings, until):
        checked.append((settings.data.name, until))
        raise BadInput([Fault("ann/one", "no masks", "Put masks beside the pictures.")])

    checked: list[tuple[str, str]] = []
    monkeypatch.setattr(actor, "dispatch", lambda work: pytest.fail(f"{work.deployment} was dispatched"))
    monkeypatch.setattr(actor, "show_stages", shown)
    parent = actor.actor_flow(replace(tiny.SERVICE, check=check))
    with pytest.raises(BadInput, match="no masks"):
        asyncio.run(parent.fn(**ordered))
    assert checked == [("data", "cloth")]


def test_a_sequence_that_is_finished_needs_its_inputs_no_more(ordered, monkeypatch):
    monkeypatch.setattr(actor, "survey", lambda request, store: Survey({}, {}))
    monkeypatch.setattr(actor, "show_stages", shown)
    service = replace(tiny.SERVICE, check=lambda settings, until: pytest.fail("nothing is computed"))
    assert asyncio.run(actor.actor_flow(service).fn(**ordered)) is None


def test_the_avatars_service_checks_what_submit_checks():
    assert deployed.SERVICE.check is preflight


async def shown(*_):
    """As if a server had taken the table."""


def test_a_group_in_which_a_stage_took_too_long_has_timed_out(ordered, monkeypatch):
    def late(*_, shared):
        raise ChildTimedOut("still running after 3 s")

    monkeypatch.setattr(group, "end_orphans", list)
    monkeypatch.setattr(group, "run_stage", late)
    monkeypatch.setattr(group, "Shown", lambda *_: lambda record: None)
    monkeypatch.setattr(group, "this_run", SimpleNamespace(id="3f0a"))
    state = tiny.vision.fn(**ordered)
    assert (state.type, state.name) == (StateType.FAILED, "TimedOut") and "still running after 3 s" in state.message
    (record,) = (Store(tiny.load().store).root / ".runs").glob("*.json")
    told = json.loads(record.read_text())
    assert (told["state"], told["flow_run"]) == ("timed out", "3f0a")


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
