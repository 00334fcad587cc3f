"""Helpers: runs in a stage's own pool that take part in its computation from other machines (`tasks/shared_map.py`).

Nobody waits for one: where no worker is free the stage goes on alone, and a helper that comes late finds the artifact and ends. They stand
in the queue `helpers`, behind everything else.
"""

import asyncio
from typing import Any

import httpx
from prefect import Flow, flow
from prefect.client.orchestration import get_client
from prefect.exceptions import ObjectNotFound
from prefect.logging import get_run_logger

from flows.line import present
from flows.request import Request
from flows.service.dispatch import Work, WorkFailed, digest, submit
from flows.service.order import Service
from flows.service.settings import json_settings
from storage_schemas.reference import ArtifactRef
from tasks.stage import Stage

QUEUE = "helpers"


def helper_flow(service: Service) -> Flow:
    """The flow `helper`: goes to the stage named and helps until it has its artifact."""

    @flow(name="helper", persist_result=False)  # whoever asks for it names the run
    def helper(actor: str, sequence: str, settings: dict[str, Any], stage: str) -> None:
        request, store = service.open(actor, sequence, stage, settings)

        def bring(now: Stage, inputs: dict[str, ArtifactRef | None], done: dict[str, ArtifactRef]) -> ArtifactRef | None:
            ready = present(inputs)
            if ready is None:
                return None
            parameters = request.parameters(now, done, store)
            if now.name == stage:
                now.help(store, actor, sequence, ready, parameters, request.recording)
            return store.find(actor, sequence, now.name, now.key(ready, parameters))

        request.line.walk(stage, bring)

    return helper


def ask_for_helpers(request: Request, stage: Stage, key: str, count: int) -> None:
    """Have `count` helpers submitted for this stage; a server that does not take them costs a warning."""

    async def ask() -> None:
        async with get_client() as client:
            for n in range(count):
                await submit(client, _work(request, stage, key, n))

    try:
        asyncio.run(ask())
    except (httpx.HTTPError, ObjectNotFound, WorkFailed) as refused:
        get_run_logger().warning("%s: no helpers: %s %s", stage.name, type(refused).__name__, refused)


def _work(request: Request, stage: Stage, key: str, n: int) -> Work:
    parameters = {
        "actor": request.actor,
        "sequence": request.sequence,
        "settings": json_settings(request.settings),
        "stage": stage.name,
    }
    name = f"{request.actor} {request.sequence}: {stage.name}, helper {n + 1}"
    return Work("helper/service", parameters, f"helper-{n}-{digest([parameters, key])}", name, QUEUE)
