"""What a person sees who watches only the Prefect UI: how far each stage is, and the table of an actor's stages.

A server that does not take it is no reason to stop computing: what could not be shown is shown at the next change.
"""

import re
import time
from contextlib import suppress
from typing import cast
from uuid import UUID

import httpx
from prefect.artifacts import create_progress_artifact, create_table_artifact, update_progress_artifact

from flows.request import Request
from flows.runs import RunRecord
from flows.service.survey import Survey

EVERY_S = 4.0


def artifact_name(*parts: str) -> str:
    """Parts as the key of a Prefect artifact: lower case, digits and dashes."""
    return re.sub(r"[^a-z0-9]+", "-", "-".join(parts).lower()).strip("-")


class Shown:
    """Listens to a run record and keeps one progress artifact per stage, renewed every few seconds at most."""

    def __init__(self, actor: str, sequence: str) -> None:
        self.actor, self.sequence = actor, sequence
        self.artifacts: dict[str, UUID] = {}
        self.last = 0.0

    def __call__(self, record: RunRecord) -> None:
        """Told of every change of the record."""
        for stage, entry in record.stages.items():
            with suppress(httpx.HTTPError):
                if entry["state"] == "running" and time.monotonic() - self.last > EVERY_S:
                    self._show(stage, 100 * entry["fraction"], entry["text"])
                elif entry["state"] == "completed" and stage in self.artifacts:
                    update_progress_artifact(self.artifacts.pop(stage), progress=100.0)

    def _show(self, stage: str, percent: float, text: str) -> None:
        self.last = time.monotonic()
        said = f"{self.actor} {self.sequence}: {stage} {text}".strip()
        if stage in self.artifacts:
            update_progress_artifact(self.artifacts[stage], progress=percent, description=said)
        else:
            key = artifact_name(self.actor, self.sequence, stage)
            made = create_progress_artifact(progress=percent, key=key, description=said)
            self.artifacts[stage] = cast("UUID", made)  # not a coroutine where no loop runs


async def show_stages(request: Request, found: Survey, running: set[str], failures: dict[str, str]) -> None:
    """The table of one sequence: every stage with its state, its key and why it failed."""
    missing = {stage: key for stages in found.ready.values() for stage, key in stages.items()}
    rows = []
    for stage in request.line.stages.values():
        if stage.name in found.done:
            state, key = "done", found.done[stage.name].key
        elif stage.name in missing:
            state, key = ("running" if stage.name in running else "failed"), missing[stage.name]
        else:
            state, key = "waiting", ""
        why = failures.get(stage.pool, "") if state == "failed" else ""
        rows.append({"stage": stage.name, "pool": stage.pool, "state": state, "key": key[:12], "why": why})
    key, said = artifact_name(request.actor, request.sequence), f"{request.actor} {request.sequence}"
    with suppress(httpx.HTTPError):
        await create_table_artifact(rows, key=key, description=said)
