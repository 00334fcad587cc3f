"""What was asked for, planned and run stage by stage, on any line."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flows.line import Line
from flows.runs import RunRecord, StageReport
from storage_schemas.capture import Capture
from storage_schemas.provenance import Provenance
from storage_schemas.reference import ArtifactRef
from storage_schemas.store import Store
from tasks.stage import Stage


@dataclass(frozen=True)
class Request:
    """What was asked for: one sequence of one actor, up to a stage, with all parameters resolved."""

    actor: str
    sequence: str
    settings: Any
    line: Line
    until: str = "report"
    scores: Callable[[dict[str, ArtifactRef]], dict[str, Any] | None] = lambda artifacts: None

    def parameters(self, stage: Stage, done: dict[str, ArtifactRef], store: Store) -> Any:
        """The parameters of one stage; the report is also told what was scored, what each stage before it took and what it warned of."""
        parameters = getattr(self.settings, stage.name)
        if stage.name != "report":
            return parameters
        told = {name: _told(ref, store.provenance(ref)) for name, ref in done.items()}
        return parameters.model_copy(update={"scores": self.scores(done), "stages": told})

    @property
    def recording(self) -> Path:
        """Where the recording lies."""
        return Path(self.settings.capture.recording)


@dataclass(frozen=True)
class Planned:
    """What a run would do with one stage and why."""

    stage: str
    key: str | None
    cached: bool
    why: str


def plan_actor(request: Request, store: Store) -> list[Planned]:
    """What `run_actor` would do, without doing it: which stages are in the store, which would run, and which key field changed."""
    planned: list[Planned] = []

    def consider(stage: Stage, inputs: dict[str, Any], done: dict[str, ArtifactRef]) -> ArtifactRef | None:
        missing = [name for name, ref in inputs.items() if ref is None]
        if missing:
            planned.append(Planned(stage.name, None, False, f"its input {', '.join(missing)} will be made anew"))
            return None
        parameters = request.parameters(stage, done, store)
        fields, key = stage.key_fields(inputs, parameters), stage.key(inputs, parameters)
        ref = store.find(request.actor, request.sequence, stage.name, key)
        why = "in the store" if ref else _why(fields, store.latest(request.actor, request.sequence, stage.name), store)
        planned.append(Planned(stage.name, key, ref is not None, why))
        return ref

    request.line.walk(request.until, consider)
    return planned


def run_stage(
    request: Request,
    store: Store,
    record: RunRecord,
    stage: Stage,
    inputs: dict[str, ArtifactRef],
    done: dict[str, ArtifactRef],
    *,
    shared: bool = False,
) -> ArtifactRef:
    """Compute one stage, or find it, as a task of the Prefect flow this is called from; `shared` with helpers."""
    parameters = request.parameters(stage, done, store)
    with record.stage(stage.name, stage.key(inputs, parameters)) as report:
        task = stage.as_task(store, recording=request.recording, progress=report.progress, warn=report.warn, shared=shared)
        result = task(
            request.actor,
            request.sequence,
            {name: ref.model_dump(mode="json") for name, ref in inputs.items()},
            parameters.model_dump(mode="json"),
        ).result()
        ref = ArtifactRef.model_validate(result["ref"])
        if result["cached"]:
            tell_kept_warnings(report, stage, ref, store)
        report.done(cached=result["cached"], seconds=0.0 if result["cached"] else result["seconds"])
    return ref


def tell_kept_warnings(report: StageReport, stage: Stage, ref: ArtifactRef, store: Store) -> None:
    """What was warned of when the artifact was made: its provenance knows, and a capture itself, whose provenance may be from before it did."""
    own = store.open(ref, Capture).warnings if stage.writes is Capture else ()
    for said in dict.fromkeys((*store.provenance(ref).reasons, *own)):
        report.warn(said)


def _told(ref: ArtifactRef, origin: Provenance) -> dict[str, Any]:
    """Without warnings nothing is said of them: reports from before they were kept are found again."""
    told = {"seconds": round(origin.seconds, 1), "key": ref.key}
    return told | {"warnings": list(origin.reasons)} if origin.reasons else told


def _why(fields: dict[str, Any], before: ArtifactRef | None, store: Store) -> str:
    """Which field of the key differs from the newest artifact of this stage."""
    if before is None:
        return "never made"
    if store.find(before.actor, before.sequence, before.stage, before.key) is None:
        return "its artifact is gone from the store"
    past = store.provenance(before)
    was = {"stage_version": past.stage_version, "parameters": past.parameters, "weights": past.weights}
    was["inputs"] = {name: ref.digest for name, ref in past.inputs.items()}
    changes = [change for name, value in was.items() for change in _changes(name, value, fields[name])]
    return "; ".join(changes)


def _changes(name: str, was: Any, now: Any) -> list[str]:
    if was == now:
        return []
    if isinstance(was, dict) and isinstance(now, dict):
        return [c for k in sorted(was.keys() | now.keys()) for c in _changes(f"{name}.{k}", was.get(k), now.get(k))]
    return [f"{name}: {_short(was)} → {_short(now)}"]


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 40 else text[:12] + "…"
