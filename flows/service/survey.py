"""What is done for one sequence and what could be done next, by looking into the store alone."""

from dataclasses import dataclass

from flows.line import present
from flows.request import Request
from storage_schemas.reference import ArtifactRef
from storage_schemas.store import Store
from tasks.stage import Stage


@dataclass(frozen=True)
class Survey:
    """`done`: artifact of each stage that has one. `ready`: pool → {stage: key} of what has all inputs and is missing."""

    done: dict[str, ArtifactRef]
    ready: dict[str, dict[str, str]]


def survey(request: Request, store: Store) -> Survey:
    """Go along the line without computing."""
    ready: dict[str, dict[str, str]] = {}

    def bring(stage: Stage, inputs: dict[str, ArtifactRef | None], done: dict[str, ArtifactRef]) -> ArtifactRef | None:
        known = present(inputs)
        if known is None:
            return None
        key = stage.key(known, request.parameters(stage, done, store))
        ref = store.find(request.actor, request.sequence, stage.name, key)
        if ref is None:
            ready.setdefault(stage.pool, {})[stage.name] = key
        return ref

    return Survey(request.line.walk(request.until, bring), ready)
