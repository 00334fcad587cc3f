"""The sweeper: finds runs whose state is not true any more, looks again, and mends it.

* Running, but no heartbeat for minutes: crashed. (The zombie automation does this within seconds; it misses runs older than itself.)
* Pending for minutes: crashed; its worker died between taking and starting it, and it may hold a concurrency slot.
* Cancelling for minutes, or open while its parent was cancelled: cancelled.
* Crashed, and nobody waits for it: submitted again, three times at most; then failed, with the reason. Whatever a parent dispatched is
  that parent's to submit again (`dispatch.py`); a sweeper that crashed is followed by the next one.
"""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any
from uuid import UUID

from prefect import Flow, flow
from prefect.artifacts import create_table_artifact
from prefect.client.orchestration import PrefectClient, get_client
from prefect.client.schemas.filters import (
    FlowRunFilter,
    FlowRunFilterEndTime,
    FlowRunFilterStartTime,
    FlowRunFilterState,
    FlowRunFilterStateType,
)
from prefect.client.schemas.objects import FlowRun, State, StateType
from prefect.events.filters import EventFilter, EventNameFilter, EventOccurredFilter, EventResourceFilter
from prefect.exceptions import ObjectNotFound
from prefect.runtime import flow_run as this_run
from prefect.states import AwaitingRetry, Cancelled, Crashed, Failed

from flows.service.cancellation import OPEN, cancel
from flows.service.leftovers import end_orphans

SILENT = timedelta(seconds=180)
UNSTARTED = timedelta(seconds=240)
UNSTOPPED = timedelta(seconds=240)
# a frozen process is killed by then (`leftovers.py`): a worker that still has it ends when it is given the run again
RESTED = timedelta(seconds=90)
TRIES = 3
LOOK_BACK = timedelta(days=1)
TRIED = "resubmitted:"


@dataclass(frozen=True)
class Mended:
    """One run, what was done about it, and why."""

    run: str
    done: str
    why: str


def sweeper_flow(unstarted: timedelta = UNSTARTED) -> Flow:
    """The flow `sweeper`, scheduled every two minutes. `unstarted`: how long a start may take (pulling an image takes minutes)."""

    @flow(name="sweeper", flow_run_name="sweep", persist_result=False)  # without a name, animals fill the list of runs
    async def sweeper() -> None:
        end_orphans()
        async with get_client() as client:
            me = await client.read_flow_run(UUID(this_run.id))
            await _skip_missed(client, me)
            if await is_swept(client, me):
                return
            mended = await sweep(client, unstarted=unstarted)
        if mended:
            await create_table_artifact([vars(m) for m in mended], key="sweeper")

    return sweeper


async def sweep(
    client: PrefectClient, now: Callable[[], datetime] = lambda: datetime.now(UTC), *, unstarted: timedelta = UNSTARTED
) -> list[Mended]:
    """Look at every open run and every recent crash; what was mended."""
    mended: list[Mended] = []

    async def mend(run: FlowRun, state: State, done: str, why: str) -> None:
        fresh = await client.read_flow_run(run.id)  # a heartbeat may arrive between Completed and the end of the process
        if fresh.state.type == run.state.type and fresh.state.timestamp == run.state.timestamp:
            await client.set_flow_run_state(run.id, state, force=True)
            mended.append(Mended(run.name, done, why))

    for run in await _runs(client, *OPEN, StateType.CANCELLING):
        age = now() - run.state.timestamp
        if (parent := _parent(run)) and await _is_cancelled(client, parent):
            await cancel(client, [run])
            mended.append(Mended(run.name, "cancelled", "its parent was cancelled"))
        elif run.state.type == StateType.RUNNING and age > SILENT and await _is_silent(client, run, now()):
            await mend(run, Crashed(message=f"no sign of life for {SILENT.seconds} s"), "crashed", "no heartbeat")
        elif run.state.type == StateType.PENDING and age > unstarted:
            await mend(run, Crashed(message=f"taken by a worker {age.seconds} s ago and never started"), "crashed", "never started")
        elif run.state.type == StateType.CANCELLING and age > UNSTOPPED:
            await mend(run, Cancelled(message="its worker did not answer"), "cancelled", "its worker did not answer")
    sweepers = await _flow(client, "sweeper")
    for run in await _runs(client, StateType.CRASHED, ended=FlowRunFilterEndTime(after_=_moment(now() - LOOK_BACK))):
        if run.deployment_id is None or _parent(run) is not None or run.flow_id == sweepers:
            continue
        if now() - run.state.timestamp < RESTED:
            continue
        why, tries = run.state.message or "no reason given", _tries(run)
        if tries < TRIES:
            await client.update_flow_run(run.id, tags=[*(t for t in run.tags if not t.startswith(TRIED)), f"{TRIED}{tries + 1}"])
            await mend(run, AwaitingRetry(), "submitted again", why)
        else:
            await mend(run, Failed(message=f"crashed {1 + TRIES} times, the last time: {why}"), "failed", why)
    return mended


async def _runs(
    client: PrefectClient, *types: StateType, started: FlowRunFilterStartTime | None = None, ended: FlowRunFilterEndTime | None = None
) -> list[FlowRun]:
    wanted = FlowRunFilter(state=FlowRunFilterState(type=FlowRunFilterStateType(any_=list(types))), start_time=started, end_time=ended)
    found: list[FlowRun] = []
    while page := await client.read_flow_runs(flow_run_filter=wanted, limit=200, offset=len(found)):
        found += page
    return found


async def _flow(client: PrefectClient, name: str) -> UUID | None:
    try:
        return (await client.read_flow_by_name(name)).id
    except ObjectNotFound:
        return None


def _moment(at: datetime) -> Any:
    """A time as Prefect's filters declare it; they take a datetime and convert it."""
    return at


def _parent(run: FlowRun) -> UUID | None:
    return next((UUID(tag.partition(":")[2]) for tag in run.tags if tag.startswith("parent:")), None)


def _tries(run: FlowRun) -> int:
    return next((int(tag.removeprefix(TRIED)) for tag in run.tags if tag.startswith(TRIED)), 0)


async def _is_cancelled(client: PrefectClient, run: UUID) -> bool:
    """Whether nobody wants what a run has dispatched; a run that was deleted wants nothing more either."""
    try:
        return (await client.read_flow_run(run)).state.type in (StateType.CANCELLED, StateType.CANCELLING)
    except ObjectNotFound:
        return True


async def _is_silent(client: PrefectClient, run: FlowRun, now: datetime) -> bool:
    beats = EventFilter(
        event=EventNameFilter(name=["prefect.flow-run.heartbeat"]),
        resource=EventResourceFilter(id=[f"prefect.flow-run.{run.id}"]),
        occurred=EventOccurredFilter(since=_moment(now - SILENT)),
    )
    return not (await client.read_events(beats, limit=1)).events


async def is_swept(client: PrefectClient, me: FlowRun) -> bool:
    """Whether an earlier sweep is still at work: on a machine out of breath they would pile up and stand in each other's way."""
    began = me.start_time or datetime.now(UTC)
    recent = await _runs(client, StateType.RUNNING, started=FlowRunFilterStartTime(after_=_moment(began - SILENT)))
    others = [run for run in recent if run.flow_id == me.flow_id and run.id != me.id]
    return any(run.start_time is not None and run.start_time < began for run in others)


async def _skip_missed(client: PrefectClient, me: FlowRun) -> None:
    """After a night without workers one sweep is enough."""
    mine = me.expected_start_time or datetime.now(UTC)
    for run in await _runs(client, StateType.SCHEDULED):
        if run.flow_id == me.flow_id and run.expected_start_time is not None and run.expected_start_time < mine:
            await client.set_flow_run_state(run.id, Cancelled(message="a later sweep did this"))


sweeper = sweeper_flow()  # here, not in `deployed.py`: a process every two minutes need not import the pipeline
