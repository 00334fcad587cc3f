"""A dataset: every sequence below the data folder, planned against the store.

A sequence is finished when all artifacts of its present request are in the store. Whoever finishes one leaves a mark with the digest of
the request (settings, stage versions, contents of recording and models) and the artifacts' keys and digests, so that a plan over ten thousand finished sequences
works out no key. A mark is only that short cut: whether the artifacts are there and whole is asked of the store, mark or none (of an object
store in two requests per artifact).
"""

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from flows.request import Request
from flows.service.settings import same_settings
from flows.service.survey import survey
from storage_schemas.durable import make_folders, replace_file
from storage_schemas.key import canonical_json
from storage_schemas.reference import ArtifactRef, name_faults
from storage_schemas.store import Store
from tasks.stage import SEALED, Count, NotNegative, Parameters, Stage

State = Literal["finished", "new", "changed", "unfinished", "refused"]


class DatasetParameters(Parameters):
    """What the dataset flow may use. in_flight: sequences at once; gpu_hours: quota of one run of the flow, in hours of the pools tracking
    and rendering, which use no GPU yet; store_gb: quota of the store; keep_free_gb: disk space that stays free; until: last stage.
    """

    in_flight: Count = 4
    gpu_hours: NotNegative | None = None
    store_gb: NotNegative | None = None
    keep_free_gb: NotNegative = 5.0
    until: str = "report"


@dataclass(frozen=True)
class Sequence:
    """One recording below the data folder."""

    actor: str
    sequence: str
    recording: Path


@dataclass(frozen=True)
class Standing:
    """How one sequence stands: finished, new, changed (finished once, under another request), unfinished, or refused, and why."""

    actor: str
    sequence: str
    state: State
    why: str


def find_sequences(data: Path) -> Iterator[Sequence]:
    """Every <data>/<actor>/<sequence>, sorted; truths and hidden folders are none."""
    for actor in _folders(data):
        for sequence in _folders(actor):
            yield Sequence(actor.name, sequence.name, sequence)


def plan_dataset(sequences: Iterable[Sequence], request_of: Callable[[Sequence], Request], store: Store) -> Iterator[Standing]:
    """How each stands, one after the other, without computing anything."""
    for at in sequences:
        if faults := [f for n, what in ((at.actor, "actor"), (at.sequence, "sequence")) for f in name_faults(n, f"{what} {at.recording}")]:
            yield Standing(at.actor, at.sequence, "refused", "; ".join(map(str, faults)))
            continue
        request = request_of(at)
        yield Standing(at.actor, at.sequence, *_standing(request, store))


def counts(standings: Iterable[Standing]) -> dict[str, int]:
    """How many there are of each state."""
    return dict(Counter(standing.state for standing in standings))


def mark_finished(request: Request, store: Store, done: dict[str, ArtifactRef]) -> None:
    """Leave the mark of a finished sequence, if the disk lets us: it is a short cut only."""
    path = _mark(store, request)
    artifacts = {ref.stage: [ref.key, ref.digest] for ref in done.values()}
    with suppress(OSError):
        make_folders(path.parent)
        content = json.dumps({"request": request_digest(request), "artifacts": artifacts}).encode()
        replace_file(path, content, forced=False)


def request_digest(request: Request) -> str:
    """Changes whenever any key along the line could change."""
    stages = {name: [stage.version, stage.writes.schema_version, _weights(request, stage)] for name, stage in request.line.stages.items()}
    settings = request.settings.model_copy(update={"capture": request.settings.capture.model_copy(update={"recording": None})})
    decides = [same_settings(settings), canonical_json(stages), request.until]
    return hashlib.sha256("\n".join(decides).encode()).hexdigest()


def _weights(request: Request, stage: Stage) -> dict[str, str]:
    """Digests of the model files and folders of a stage: one may be replaced in its place."""
    return stage.key_fields({}, getattr(request.settings, stage.name))["weights"]


def _standing(request: Request, store: Store) -> tuple[State, str]:
    mark = _read_mark(_mark(store, request))
    if mark is not None and mark["request"] == request_digest(request) and _all_there(request, store, mark["artifacts"]):
        return "finished", "all in the store"
    found = survey(request, store)
    if not found.ready and len(found.done) == _wanted(request):
        mark_finished(request, store, found.done)
        return "finished", "all in the store"
    missing = ", ".join(stage for stages in found.ready.values() for stage in stages)
    if mark is not None:
        return "changed", f"to be made: {missing} and what follows"
    return ("unfinished", f"to be made: {missing} and what follows") if found.done else ("new", "nothing in the store")


def _wanted(request: Request) -> int:
    names = list(request.line.stages)
    reached = names[: names.index(request.until) + 1]
    return len({*reached, request.line.closing} - {None}) if request.until != names[0] else 1


def _all_there(request: Request, store: Store, artifacts: dict[str, list[str]]) -> bool:
    for stage, (key, digest) in artifacts.items():
        ref = store.find(request.actor, request.sequence, stage, key)
        if ref is None or ref.digest != digest:
            return False
    return True


def _mark(store: Store, request: Request) -> Path:
    return store.root / ".finished" / request.actor / f"{request.sequence}.{request.until}.json"


def _read_mark(path: Path) -> dict[str, Any] | None:
    try:
        mark = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return None
    return mark if isinstance(mark, dict) and {"request", "artifacts"} <= mark.keys() else None


def _folders(parent: Path) -> list[Path]:
    if not parent.is_dir():
        return []
    return sorted(p for p in parent.iterdir() if p.is_dir() and not p.name.startswith(".") and not p.name.endswith(SEALED))
