"""One actor, handed to the service instead of being processed here."""

import asyncio
import hashlib
from typing import Any

from flows.request import Request
from flows.service.dispatch import Work, dispatch, submit
from flows.service.server import speak_to_server
from flows.service.survey import json_settings, same_settings
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
    decides = [request.actor, request.sequence, request.until, same_settings(request.settings)]
    key = hashlib.sha256("\n".join(decides).encode()).hexdigest()[:32]
    parameters = _parameters(request, store) | {"queue": queue}
    return Work("actor/service", parameters, f"actor-{key}", f"{request.actor} {request.sequence}", queue)


def _parameters(request: Request, store: Store) -> dict[str, Any]:
    """JSON whose paths mean the same on every machine that shares them."""
    capture = request.settings.capture.model_copy(update={"recording": request.recording.resolve()})
    places = {"store": store.location, "data": request.settings.data.resolve(), "capture": capture}
    settings = json_settings(request.settings.model_copy(update=places))
    return {"actor": request.actor, "sequence": request.sequence, "settings": settings, "until": request.until}
