"""Runs that look alive and are not: each is brought to the state that is true, and one that spoke meanwhile is left alone."""

import asyncio
from datetime import UTC, datetime, timedelta

import pytest
from prefect.client.orchestration import get_client
from prefect.states import Cancelled, Completed, Crashed, Pending, Running, Scheduled

from flows.service import sweeper
from flows.service.sweeper import TRIES, is_swept, sweep
from tests.service.place import order

LATER = timedelta(minutes=10)


def later() -> datetime:
    return datetime.now(UTC) + LATER


@pytest.fixture
def swept(running):
    """swept(state, tags) → the run in this state after one sweep ten minutes later, and what was said about it."""

    async def go(state, *more_sweeps, tags=()):
        async with get_client() as client:
            deployment = await client.read_deployment_by_name("vision/idle")
            run = await client.create_flow_run_from_deployment(deployment.id, parameters=_parameters(), tags=list(tags))
            await client.set_flow_run_state(run.id, state, force=True)
            said = [m for m in await sweep(client, later) if m.run == run.name]
            for again in more_sweeps:
                await client.set_flow_run_state(run.id, again, force=True)
                said += [m for m in await sweep(client, later) if m.run == run.name]
            return (await client.read_flow_run(run.id)).state, said

    return lambda *states, **more: asyncio.run(go(*states, **more))


def _parameters() -> dict:
    return order("ann", "nobody")


def test_a_silent_run_is_crashed_and_then_submitted_again(swept):
    state, said = swept(Running())
    assert [m.done for m in said] == ["crashed", "submitted again"]
    assert state.name == "AwaitingRetry"


def test_a_run_that_never_started_is_submitted_again(swept):
    _, said = swept(Pending())
    assert "never started" in said[0].why


def test_after_three_tries_it_fails_with_the_last_reason(swept):
    state, said = swept(*[Crashed(message=f"lost machine {n}") for n in range(TRIES + 1)])
    assert [m.done for m in said] == ["submitted again"] * TRIES + ["failed"]
    assert state.name == "Failed"
    assert f"crashed {TRIES + 1} times, the last time: lost machine {TRIES}" in state.message


def test_what_a_parent_dispatched_is_left_to_it(swept):
    state, said = swept(Crashed(message="gone"), tags=["parent:00000000-0000-0000-0000-000000000000"])
    assert said == [] and state.is_crashed()


def test_a_crash_rests_before_the_run_is_given_to_a_worker_again(running):
    async def go():
        async with get_client() as client:
            deployment = await client.read_deployment_by_name("vision/idle")
            run = await client.create_flow_run_from_deployment(deployment.id, parameters=_parameters())
            await client.set_flow_run_state(run.id, Crashed(message="frozen"), force=True)
            said = [m for m in await sweep(client) if m.run == run.name]
            return (await client.read_flow_run(run.id)).state, said

    state, said = asyncio.run(go())
    assert said == [] and state.is_crashed()


def test_a_crashed_sweeper_is_followed_by_the_next_one_not_repeated(running):
    async def go():
        async with get_client() as client:
            deployment = await client.read_deployment_by_name("sweeper/service")
            tomorrow = Scheduled(scheduled_time=datetime.now(UTC) + timedelta(days=1))  # a worker must not take it
            run = await client.create_flow_run_from_deployment(deployment.id, state=tomorrow)
            await client.set_flow_run_state(run.id, Crashed(message="gone"), force=True)
            said = [m for m in await sweep(client, later) if m.run == run.name]
            return (await client.read_flow_run(run.id)).state, said

    state, said = asyncio.run(go())
    assert said == [] and state.is_crashed()


def test_of_two_sweeps_at_once_the_later_one_leaves(running):
    async def go():
        async with get_client() as client:
            deployment = await client.read_deployment_by_name("sweeper/service")
            tomorrow = Scheduled(scheduled_time=datetime.now(UTC) + timedelta(days=1))
            both = [await client.create_flow_run_from_deployment(deployment.id, state=tomorrow) for _ in range(2)]
            for run in both:
                await client.set_flow_run_state(run.id, Running(), force=True)
            both = [await client.read_flow_run(run.id) for run in both]
            found = [await is_swept(client, run) for run in both]
            for run in both:
                await client.set_flow_run_state(run.id, Completed(), force=True)
            return found[1], await is_swept(client, both[1])

    later_leaves, alone_leaves = asyncio.run(go())
    assert later_leaves and not alone_leaves


def test_a_child_of_a_cancelled_parent_is_cancelled(running):
    async def go():
        async with get_client() as client:
            deployment = await client.read_deployment_by_name("vision/idle")
            parent = await client.create_flow_run_from_deployment(deployment.id, parameters=_parameters())
            await client.set_flow_run_state(parent.id, Cancelled(), force=True)
            child = await client.create_flow_run_from_deployment(deployment.id, parameters=_parameters(), tags=[f"parent:{parent.id}"])
            await sweep(client, later)
            return (await client.read_flow_run(child.id)).state

    assert asyncio.run(go()).is_cancelled()


def test_a_child_whose_parent_was_deleted_is_cancelled_and_the_sweep_goes_on(running):
    async def go():
        async with get_client() as client:
            deployment = await client.read_deployment_by_name("vision/idle")
            gone = "parent:00000000-0000-0000-0000-00000000dead"
            child = await client.create_flow_run_from_deployment(deployment.id, parameters=_parameters(), tags=[gone])
            await sweep(client, later)
            return (await client.read_flow_run(child.id)).state

    assert asyncio.run(go()).is_cancelled()


def test_a_run_of_days_that_crashes_now_is_submitted_again(swept):
    """What counts is when it ended, not when it started."""
    started = Running(timestamp=datetime.now(UTC) - timedelta(days=3))
    state, said = swept(started, Crashed(message="out of memory"))
    assert said[-1].why == "out of memory" and state.name == "AwaitingRetry"


def test_a_run_that_completes_while_it_is_looked_at_stays_completed(swept, running, monkeypatch):
    async def completes_meanwhile(client, run, now):
        await client.set_flow_run_state(run.id, Completed(), force=True)
        return True

    monkeypatch.setattr(sweeper, "_is_silent", completes_meanwhile)
    state, said = swept(Running())
    assert state.is_completed() and said == []
