"""The parent of one sequence: looks into the store, checks inputs, has the pools do what can be done next, and looks again."""

import asyncio
from typing import Any

from prefect import Flow, flow
from prefect.client.schemas.objects import State

from flows.dataset import mark_finished
from flows.request import Request
from flows.service.cancellation import cancel_children
from flows.service.dispatch import FAILED, Work, WorkFailed, digest, dispatch
from flows.service.order import Service
from flows.service.settings import json_settings
from flows.service.shown import show_stages
from flows.service.survey import survey
from storage_schemas.reference import ArtifactRef
from storage_schemas.store import Store

LOOK_EVERY_S = 30.0  # into the store, for the table that people see


def actor_flow(service: Service) -> Flow:
    """The flow `actor`: one sequence of one actor through all pools."""

    @flow(name="actor", flow_run_name="{actor} {sequence}", persist_result=False, on_cancellation=[cancel_children])
    async def actor(actor: str, sequence: str, settings: dict[str, Any], until: str = "report", queue: str = "single") -> State | None:
        request, store = service.open(actor, sequence, until, settings)
        if survey(request, store).ready:
            await asyncio.to_thread(service.check, request.settings, until)
        try:
            done = await conduct(request, store, queue)
        except WorkFailed as failed:
            if failed.ending == FAILED:
                raise
            return failed.as_state()
        mark_finished(request, store, done)
        return None

    return actor


async def conduct(request: Request, store: Store, queue: str) -> dict[str, ArtifactRef]:
    """Dispatch until everything is in the store. Raises WorkFailed, once nothing more is under way, if any group failed."""
    flying: dict[str, tuple[asyncio.Task, dict[str, str]]] = {}
    failures: dict[str, str] = {}
    endings: set[str] = set()
    shown: tuple[set[str], set[str]] | None = None
    while True:
        found = survey(request, store)
        for pool, stages in found.ready.items():
            if pool not in flying and pool not in failures:
                flying[pool] = asyncio.create_task(dispatch(_work(request, store, pool, stages, queue))), stages
        running = {stage for pool in flying for stage in found.ready.get(pool, {})}  # a run goes from stage to stage of its pool
        if shown != (set(found.done), running) or not flying:
            await show_stages(request, found, running, failures)
            shown = set(found.done), running
        if not flying:
            break
        tasks = [task for task, _ in flying.values()]
        await asyncio.wait(tasks, timeout=LOOK_EVERY_S, return_when=asyncio.FIRST_COMPLETED)
        for pool in [pool for pool, (task, _) in flying.items() if task.done()]:
            task, stages = flying.pop(pool)
            if reason := _failure(task, stages, survey(request, store).ready.get(pool, {})):
                failures[pool] = reason
                endings.add(getattr(task.exception(), "ending", FAILED))
    if failures:
        raise WorkFailed("; ".join(failures.values()), endings.pop() if len(endings) == 1 else FAILED)
    return found.done


def _work(request: Request, store: Store, pool: str, stages: dict[str, str], queue: str) -> Work:
    """One pool's part; its key is where the artifacts will lie, not the settings: requests that go apart later share what is the same."""
    key = digest([store.location, request.actor, request.sequence, stages])
    parameters = {
        "actor": request.actor,
        "sequence": request.sequence,
        "settings": json_settings(request.settings),
        "until": request.until,
    }
    name = f"{request.actor} {request.sequence}: {pool} from {next(iter(stages))}"
    return Work(f"{pool}/service", parameters, f"{pool}-{key}", name, queue)


def _failure(task: asyncio.Task, stages: dict[str, str], still_ready: dict[str, str]) -> str | None:
    if task.exception() is not None:
        return str(task.exception())
    left = [stage for stage, key in stages.items() if still_ready.get(stage) == key]
    return f"{', '.join(left)}: the run completed but its artifact is not in the store" if left else None
