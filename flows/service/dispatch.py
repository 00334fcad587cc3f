"""The one way in which a flow has another flow run elsewhere.

    await dispatch(Work("vision/service", parameters, key="vision-3f0a…", name="ann walk: vision"))

Equal keys are one piece of work: whoever asks again while it is under way waits for the same run. A run that crashed (its process or
machine is gone) is submitted again, three times at most; any other ending but Completed raises. The server may be away for minutes.
Work that no flow asked for has no parent to do that: the sweeper submits it again, and whoever waits goes on waiting.
Children carry the tag `parent:<run>`, by which cancelling a run reaches them (`cancellation.py`).
"""

import asyncio
import hashlib
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import partial
from itertools import count
from typing import Any, TypeVar

import httpx
from prefect.client.orchestration import PrefectClient, get_client
from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterIdempotencyKey
from prefect.client.schemas.objects import FlowRun, State
from prefect.deployments import arun_deployment
from prefect.exceptions import PrefectHTTPStatusError
from prefect.runtime import flow_run as this_run
from prefect.states import Cancelled, Failed

from storage_schemas.key import canonical_json

CRASHES = 3
POLL_S = 2.0
PATIENCE_S = 300.0
FAILED, CANCELLED = "Failed", "Cancelled"  # names of states
AT_ONCE = 200  # the longest list the API returns

T = TypeVar("T")


class WorkFailed(RuntimeError):
    """A child that ended otherwise than Completed; the text says which, how and why, `ending` is the name of its state."""

    def __init__(self, text: str, ending: str = FAILED) -> None:
        super().__init__(text)
        self.ending = ending

    def as_state(self) -> State:
        """In which whoever dispatched the child ends too, so that the next above still knows."""
        return Cancelled(message=str(self)) if self.ending == CANCELLED else Failed(name=self.ending, message=str(self))


@dataclass(frozen=True)
class Work:
    """What to run: deployment `flow/name`, JSON parameters, the key that makes two requests one, and the name people see."""

    deployment: str
    parameters: dict[str, Any]
    key: str
    name: str
    queue: str | None = None


def digest(decides: Any) -> str:
    """32 digits for the key of the work that this JSON decides."""
    return hashlib.sha256(canonical_json(decides).encode()).hexdigest()[:32]


async def dispatch(work: Work) -> FlowRun:
    """Have it run and wait; the completed run. Raises WorkFailed."""
    message = ""
    async with get_client() as client:
        for _ in range(1 + CRASHES):
            run = await _ended(client, await submit(client, work))
            if run.state.is_completed():
                return run
            message = run.state.message or "no reason given"
            if not run.state.is_crashed():
                raise WorkFailed(f"{work.name}: {run.state.name}: {message}", run.state.name or FAILED)
    raise WorkFailed(f"{work.name}: crashed {1 + CRASHES} times, the last time: {message}")


async def submit(client: PrefectClient, work: Work) -> FlowRun:
    """The run of this work that is under way, or a new one."""
    past = await _past(client, work)
    for run in past:
        if not run.state.is_final():
            return run
    taken = {run.idempotency_key for run in past}  # not counted: the server's vacuum removes old runs, and a key that has one returns it
    key = next(key for n in count() if (key := f"{work.key}-{n}") not in taken)
    create = {"parameters": work.parameters, "flow_run_name": work.name, "work_queue_name": work.queue, "timeout": 0}
    return await patiently(lambda: arun_deployment(work.deployment, client=client, idempotency_key=key, tags=_family(), **create))


async def patiently(ask: Callable[[], Awaitable[T]], patience_s: float = PATIENCE_S) -> T:
    """The server's answer, asked for again while it is down or overloaded; raises its last refusal after `patience_s`."""
    until, pause = time.monotonic() + patience_s, 0.5
    while True:
        try:
            return await ask()
        except (httpx.TransportError, PrefectHTTPStatusError) as refused:
            if time.monotonic() > until or not _passing(refused):
                raise
        await asyncio.sleep(pause)
        pause = min(2 * pause, 15.0)


async def _past(client: PrefectClient, work: Work) -> list[FlowRun]:
    """All runs of this work that the server still knows."""
    past: list[FlowRun] = []
    for start in count(0, AT_ONCE):
        keys = [f"{work.key}-{n}" for n in range(start, start + AT_ONCE)]
        wanted = FlowRunFilter(idempotency_key=FlowRunFilterIdempotencyKey(any_=keys))
        page = await patiently(partial(client.read_flow_runs, flow_run_filter=wanted, limit=AT_ONCE))
        if not page:
            break
        past += page
    return past


def _passing(refused: Exception) -> bool:
    if not isinstance(refused, PrefectHTTPStatusError):
        return True
    status = refused.response.status_code
    return status == httpx.codes.TOO_MANY_REQUESTS or status >= httpx.codes.INTERNAL_SERVER_ERROR


async def _ended(client: PrefectClient, run: FlowRun) -> FlowRun:
    while not run.state.is_final() or (run.state.is_crashed() and not _family()):
        await asyncio.sleep(POLL_S)
        run = await patiently(partial(client.read_flow_run, run.id))
    return run


def _family() -> list[str]:
    return [f"parent:{this_run.id}"] if this_run.id else []
