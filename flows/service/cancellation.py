"""Cancelling a run reaches what it dispatched. Prefect itself stops at the child's border."""

from collections.abc import Iterable
from typing import Any
from uuid import UUID

from prefect import Flow
from prefect.client.orchestration import PrefectClient, get_client
from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterState, FlowRunFilterStateType, FlowRunFilterTags
from prefect.client.schemas.objects import FlowRun, State, StateType
from prefect.states import Cancelled, Cancelling

OPEN = (StateType.SCHEDULED, StateType.PENDING, StateType.RUNNING, StateType.PAUSED)


async def cancel_children(flow: Flow[..., Any], flow_run: FlowRun, state: State) -> None:
    """Hook of flows that dispatch: `on_cancellation=[cancel_children]`."""
    async with get_client() as client:
        await cancel(client, await children(client, flow_run.id))


async def children(client: PrefectClient, parent: UUID) -> list[FlowRun]:
    """The open runs that `parent` dispatched."""
    wanted = FlowRunFilter(
        tags=FlowRunFilterTags(all_=[f"parent:{parent}"]), state=FlowRunFilterState(type=FlowRunFilterStateType(any_=list(OPEN)))
    )
    return await client.read_flow_runs(flow_run_filter=wanted, limit=200)


async def cancel(client: PrefectClient, runs: Iterable[FlowRun]) -> None:
    """Ask each to stop; its worker kills it. One that has not started is cancelled at once."""
    for run in runs:
        started = run.state.type in (StateType.RUNNING, StateType.PENDING)
        await client.set_flow_run_state(run.id, Cancelling() if started else Cancelled(message="its parent was cancelled"))
