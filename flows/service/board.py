"""How a campaign stands, in the Prefect UI: its progress and its table, each one artifact that is renewed in place.

A table created anew every few seconds would stay in the database as a version each; Prefect's own `update_artifact` keeps a copy in an
event.
"""

import json
from contextlib import suppress
from typing import Any
from uuid import UUID

import httpx
from prefect.artifacts import create_progress_artifact, create_table_artifact, update_progress_artifact
from prefect.client.orchestration import get_client


class Board:
    """Shows what changed since it was last shown. What a server does not take is no reason to stop: it is shown the next time."""

    def __init__(self) -> None:
        self.progress: UUID | None = None
        self.table: UUID | None = None
        self.shown: Any = None

    async def show(self, percent: float, rows: list[dict[str, Any]], said: str) -> None:
        """The share that has ended, and the table with a line above it."""
        if self.shown == (percent, rows, said):
            return
        with suppress(httpx.HTTPError):
            await self._show_progress(percent)
            await self._show_table(rows, said)
            self.shown = percent, rows, said

    async def _show_progress(self, percent: float) -> None:
        if self.progress is None:
            self.progress = await create_progress_artifact(percent, key="dataset-progress", description="sequences that have ended")
        else:
            await update_progress_artifact(self.progress, progress=percent)

    async def _show_table(self, rows: list[dict[str, Any]], said: str) -> None:
        if self.table is None:
            self.table = await create_table_artifact(rows, key="dataset", description=said)
            return
        async with get_client() as client:
            changed = {"data": json.dumps(rows), "description": said}
            await client.request("PATCH", "/artifacts/{id}", path_params={"id": self.table}, json=changed)
