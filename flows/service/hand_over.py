"""One actor, handed to the service instead of being processed here."""

import asyncio

from flows.request import Request
from flows.service.dispatch import Work, digest, dispatch, submit
from flows.service.server import speak_to_server
from flows.service.settings import json_settings, placed
from storage_schemas.store import Store


def hand_over(request: Request, store: Store, *, wait: bool) -> str:
    """Ask the service for one sequence, before any batch; the id of its run. With `wait` until it has ended. Raises WorkFailed."""
    speak_to_server(request.settings.service)
    work = actor_work(request, store)

    async def hand() -> str:
        from prefect.client.orchestration import get_client

        async with get_client() as client:
            return str((await submit(client, work)).id)

    return str(asyncio.run(dispatch(work)).id) if wait else asyncio.run(hand())


def actor_work(request: Request, store: Store, queue: str = "single") -> Work:
    """One sequence as work for the service; its key is the request, so that asking twice is asking once."""
    settings = json_settings(placed(request.settings, store))
    parameters = {"actor": request.actor, "sequence": request.sequence, "settings": settings, "until": request.until}
    key = f"actor-{digest(parameters)}"
    return Work("actor/service", parameters | {"queue": queue}, key, f"{request.actor} {request.sequence}", queue)
