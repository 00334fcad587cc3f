"""The tiny line through a real server and real workers: what completes, what fails and why, and that nothing is computed twice."""

import asyncio
import json
from collections.abc import Callable
from uuid import UUID

import pytest
from prefect.client.orchestration import get_client
from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterTags

from flows.service.automations import armed
from flows.service.dispatch import Work, WorkFailed, dispatch
from storage_schemas.store import Store
from tests.service import tiny
from tests.service.place import order


def ask(question: Callable) -> object:
    """The server's answer."""

    async def asked() -> object:
        async with get_client() as client:
            return await question(client)

    return asyncio.run(asked())


def actor_work(sequence: str, key: str, text: str = "0.05") -> Work:
    settings = order("ann", sequence)
    tiny.recording(tiny.load().data, "ann", sequence, text)
    return Work("actor/service", settings, key, f"ann {sequence}")


@pytest.fixture(scope="module")
def ended(running):
    """Three at once: a sound actor twice under one key, and one that is refused."""
    place, _ = running
    same, bad = actor_work("same", "k-same"), actor_work("bad", "k-bad", "refuse")

    async def all_of_them() -> list:
        return await asyncio.gather(*map(dispatch, (same, same, bad)), return_exceptions=True)

    return place, asyncio.run(all_of_them())


def computed(place, sequence: str) -> int:
    return len(Store(place / "store").list("ann", sequence, "cloth"))


def test_automations_are_there_before_any_worker(running):
    assert ask(armed)


def test_a_sound_actor_passes_both_pools(ended):
    place, (sound, _, _) = ended
    assert sound.state.is_completed()
    assert {e.address.stage for e in Store(place / "store").list("ann", "same")} == {"capture", "cloth"}


def test_two_submits_of_one_key_are_one_run(ended):
    place, (one, two, _) = ended
    assert one.id == two.id
    assert computed(place, "same") == 1


def test_a_refused_child_fails_its_parent_with_the_reason(ended):
    _, (_, _, bad) = ended
    assert isinstance(bad, WorkFailed)
    assert "it says refuse" in str(bad)


def test_runs_are_named_after_actor_sequence_and_stage(ended):
    _, (one, *_) = ended
    wanted = FlowRunFilter(tags=FlowRunFilterTags(all_=[f"parent:{one.id}"]))
    children = ask(lambda client: client.read_flow_runs(flow_run_filter=wanted))
    assert {run.name for run in children} == {"ann same: vision from capture", "ann same: simulation from cloth"}


def test_a_person_sees_each_stage(ended):
    _, (one, *_) = ended
    artifacts = ask(lambda client: client.read_latest_artifacts())
    table = next(a for a in artifacts if a.key == "ann-same")
    assert [(row["stage"], row["state"]) for row in json.loads(table.data)] == [("capture", "done"), ("cloth", "done")]
    failed = next(a for a in artifacts if a.key == "ann-bad")
    assert "it says refuse" in failed.data
    assert one.id  # both tables belong to runs


@pytest.mark.slow
def test_a_dataset_does_what_is_left_and_says_how_it_went(ended):
    place, _ = ended
    with pytest.raises(WorkFailed, match="1 of 1 sequences failed"):
        asyncio.run(dispatch(Work("dataset/service", {}, "k-dataset", "dataset")))
    campaign = json.loads(next((place / "store/.datasets").glob("*.json")).read_text())
    assert campaign["counts"] == {"failed": 1, "finished": 1}
    assert "it says refuse" in next(row["why"] for row in campaign["rows"] if row["state"] == "failed")
    assert Store(place / "store").verify() == []


@pytest.mark.slow
def test_a_helper_shares_the_simulations_of_another_run(running):
    place, _ = running
    order_of = actor_work("wide", "k-wide", "3.0 parts:12").parameters
    asyncio.run(dispatch(Work("vision/service", order_of, "k-wide-vision", "ann wide: vision")))
    asyncio.run(dispatch(Work("simulation/service", order_of | {"helpers": 1}, "k-wide-cloth", "ann wide: simulation")))
    store = Store(place / "store")
    (entry,) = store.list("ann", "wide", "cloth")
    assert store.open(store.find("ann", "wide", "cloth", entry.address.key), tiny.Tiny).parts == 2
    assert store.verify() == []


@pytest.mark.slow
def test_a_parent_whose_child_is_cancelled_is_cancelled(running):
    from prefect.states import Cancelling

    work = actor_work("stopped", "k-stopped", "60")

    async def stop() -> None:
        async with get_client() as client:
            child = None
            while child is None or not child.state.is_running():
                await asyncio.sleep(0.5)
                child = next((run for run in await client.read_flow_runs() if run.name == "ann stopped: simulation from cloth"), None)
            await client.set_flow_run_state(child.id, Cancelling())

    async def both() -> WorkFailed:
        failed, _ = await asyncio.gather(dispatch(work), stop(), return_exceptions=True)
        return failed

    failed = asyncio.run(asyncio.wait_for(both(), 120))
    assert isinstance(failed, WorkFailed) and failed.ending == "Cancelled"


@pytest.mark.slow
def test_cancelling_a_parent_reaches_its_child(running):
    from flows.service.dispatch import submit

    async def cancelled() -> list:
        async with get_client() as client:
            run = await submit(client, actor_work("long", "k-long", "60"))
            child = None
            while child is None or not child.state.is_running():
                await asyncio.sleep(0.5)
                found = await client.read_flow_runs(flow_run_filter=FlowRunFilter(tags=FlowRunFilterTags(all_=[f"parent:{run.id}"])))
                child = next((r for r in found if r.name == "ann long: simulation from cloth"), None)
            from prefect.states import Cancelling

            await client.set_flow_run_state(run.id, Cancelling())
            for _ in range(120):
                await asyncio.sleep(0.5)
                states = [(await client.read_flow_run(UUID(str(i)))).state for i in (run.id, child.id)]
                if all(state.is_final() for state in states):
                    break
            return [state.name for state in states]

    assert asyncio.run(asyncio.wait_for(cancelled(), 120)) == ["Cancelled", "Cancelled"]
