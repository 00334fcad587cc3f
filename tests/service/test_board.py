"""A campaign in the UI: one table however often it is shown, failures first, and a server that is away stops nothing. Real server."""

import asyncio
import json

import httpx
from prefect import flow
from prefect.client.orchestration import get_client
from prefect.client.schemas.filters import ArtifactFilter, ArtifactFilterKey

from flows.service import board, campaign
from flows.service.board import Board
from flows.service.campaign import Campaign, Row


@flow(persist_result=False)  # artifacts belong to runs
async def shown(states: list[str]) -> tuple[int, list, str]:
    """How many tables there are, the last one's rows and what stands above it, after a campaign was shown once per state of its sequence."""
    own, at = Board(), Campaign(None)
    async with get_client() as client:
        wanted = ArtifactFilter(key=ArtifactFilterKey(any_=["dataset"]))
        before = {artifact.id for artifact in await client.read_artifacts(artifact_filter=wanted)}
        for state in states:
            at.rows = {"ann/one": Row("ann", "one", "completed"), "bob/one": Row("bob", "one", state)}
            await campaign._show(at, own)
        new = [a for a in await client.read_artifacts(artifact_filter=wanted) if a.id not in before]
    return len(new), json.loads(new[0].data), new[0].description


def test_the_table_is_renewed_in_place_with_failures_first(running):
    tables, rows, said = asyncio.run(shown(["queued", "running", "running", "failed"]))
    assert tables == 1
    assert [row["state"] for row in rows] == ["failed", "completed"]
    assert "1 failed" in said


def test_what_a_server_does_not_take_is_shown_the_next_time(monkeypatch):
    taken = []

    async def away(*_, **__):
        taken.append(1)
        raise httpx.ConnectError("away")

    monkeypatch.setattr(board, "create_progress_artifact", away)
    own = Board()
    for _ in range(2):
        asyncio.run(own.show(0.0, [], ""))
    assert len(taken) == 2
