"""What a stage is: a versioned, pure step from artifacts to one artifact, and the door through which it runs.

    @stage("body", version=1, pool="vision", timeout_s=3600)
    def fit(job: Job, capture: Capture, keypoints: Keypoints, parameters: BodyParameters) -> Body: ...

The annotations are the declaration: records are the inputs, `parameters` the settings, the return type what is published. The key of the
result is known before anything runs (`Stage.key`), so a result that is in the store is never computed again. A `ModelFile` or
`Folder` among the parameters enters the key by content, not by path, and by its stand-in where it is left out and has one (`Otherwise`).
Prefect sees one task per stage, and shows it as Cached where the store had the artifact; Prefect's own cache is not asked.
"""

import shutil
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, get_args, get_type_hints

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from storage_schemas.key import artifact_key
from storage_schemas.provenance import Provenance
from storage_schemas.record import Record
from storage_schemas.reference import ArtifactRef
from storage_schemas.store import Store
from tasks.content_digest import content_digest
from tasks.geometry.faults import BadInput
from tasks.shared_map import Map, SharedMap, Superseded

LEASE_S = 60.0
PARTS = "parts"  # below a checkpoint: results of items that were mapped
SHARED, START = "shared", "start"  # below a checkpoint: what helpers take part in, and the checkpoint as the computation found it
SEALED = ".truth"  # a folder whose name ends so is closed to every stage


class Fingerprint:
    """Marks a path that enters the key of an artifact by its content."""


@dataclass(frozen=True)
class Otherwise:
    """Marks such a path that has a stand-in where it is not given; `digest` returns what the stand-in enters the key by."""

    digest: Callable[[], str]


def _left_out(path: Any) -> Any:
    """Nothing for an empty text: TOML has no null, and as a path it would be the current directory."""
    return None if isinstance(path, str) and not path.strip() else path


ModelFile = Annotated[Path | None, BeforeValidator(_left_out), Fingerprint()]
Folder = Annotated[Path | None, BeforeValidator(_left_out), Fingerprint()]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1)]


class Parameters(BaseModel):
    """Settings of a stage: frozen, no unknown names, SI units."""

    model_config = ConfigDict(frozen=True, extra="forbid")


@dataclass(frozen=True)
class Job:
    """What a stage knows of its run: whose data, where the recording lies now, a folder that survives a kill, whom to tell how far it is.

    notes: what the provenance keeps, every warning among it. shared: the folder in which processes elsewhere take part, if any do.
    """

    actor: str
    sequence: str
    recording: Path | None
    checkpoint: Path
    progress: Callable[[float, str], None]
    warn: Callable[[str], None]
    notes: list[str] = field(default_factory=list)
    shared: Path | None = None

    def spread(self, here: Map, at_once: int) -> Map:
        """`here`, which computes `at_once` items side by side on this machine. Results are kept until the stage is done: a run that was
        killed goes on from them, and the helpers of this run, if it has any, find them.
        """
        folder = self.shared or self.checkpoint / PARTS
        folder.mkdir(exist_ok=True)
        return SharedMap(folder, here, at_once)


@dataclass(frozen=True)
class Outcome:
    """How a stage ended: the artifact, whether it was there already, and the seconds this run spent."""

    ref: ArtifactRef
    cached: bool
    seconds: float


@dataclass(frozen=True)
class Stage:
    """A declared stage; see the module docstring."""

    name: str
    version: int
    pool: str
    timeout_s: float
    retries: int
    function: Callable[..., Record]
    reads: Mapping[str, type[Record]]
    writes: type[Record]
    parameters: type[Parameters]
    spreads: bool = False

    def key_fields(self, inputs: Mapping[str, ArtifactRef], parameters: Parameters) -> dict[str, Any]:
        """Everything the key is made of, in the form `plan --explain` compares."""
        paths = {n for n, f in self.parameters.model_fields.items() if any(isinstance(m, Fingerprint) for m in f.metadata)}
        return {
            "stage": self.name,
            "stage_version": self.version,
            "schema_version": self.writes.schema_version,
            "parameters": parameters.model_dump(mode="json", exclude=paths),
            "inputs": {name: ref.digest for name, ref in inputs.items()},
            "weights": {n: digest for n in sorted(paths) if (digest := self._digest(n, getattr(parameters, n))) is not None},
        }

    def _digest(self, name: str, path: Path | None) -> str | None:
        if path is not None:
            return content_digest(path)
        return next((mark.digest() for mark in self.parameters.model_fields[name].metadata if isinstance(mark, Otherwise)), None)

    def key(self, inputs: Mapping[str, ArtifactRef], parameters: Parameters) -> str:
        """SHA-256 of the canonical JSON of `key_fields`."""
        return artifact_key(**self.key_fields(inputs, parameters))

    def run(
        self,
        store: Store,
        actor: str,
        sequence: str,
        inputs: Mapping[str, ArtifactRef],
        parameters: Parameters,
        *,
        recording: Path | None = None,
        progress: Callable[[float, str], None] = lambda fraction, text: None,
        warn: Callable[[str], None] = lambda text: None,
        shared: bool = False,
    ) -> Outcome:
        """The artifact of these inputs: found in the store, or computed and published. Safe to call from any number of processes.

        `shared`: others may `help`, if the stage spreads.
        """
        start = time.perf_counter()
        fields = self.key_fields(inputs, parameters)
        key = artifact_key(**fields)
        if (ref := store.find(actor, sequence, self.name, key)) is not None:
            store.set_latest(ref)
            return Outcome(ref, True, time.perf_counter() - start)
        with store.lease(actor, sequence, self.name, key, seconds=LEASE_S, wait=self.timeout_s):
            if (ref := store.find(actor, sequence, self.name, key)) is not None:  # another process published it while we waited
                store.set_latest(ref)
                return Outcome(ref, True, time.perf_counter() - start)
            checkpoint = store.checkpoint_dir(actor, sequence, self.name, key)
            folder = _opened_to_helpers(checkpoint) if shared and self.spreads else None
            notes: list[str] = []

            def noted(text: str) -> None:
                notes.append(text)
                warn(text)

            job = Job(actor, sequence, recording, checkpoint, progress, noted, notes, shared=folder)
            opened = {name: store.open(ref, self.reads[name]) for name, ref in inputs.items()}
            provenance = Provenance(
                stage=self.name, stage_version=self.version, inputs=dict(inputs), weights=fields["weights"], parameters=fields["parameters"]
            )
            with _sealed_from_truth():
                record = self.function(job, **opened, parameters=parameters)
            provenance = provenance.finished().model_copy(update={"reasons": tuple(notes)})
            ref = store.publish(record, actor=actor, sequence=sequence, stage=self.name, key=key, provenance=provenance)
            store.set_latest(ref)
        return Outcome(ref, False, time.perf_counter() - start)

    def help(
        self, store: Store, actor: str, sequence: str, inputs: Mapping[str, ArtifactRef], parameters: Parameters, recording: Path | None
    ) -> None:
        """Take part in a shared run of this stage until it has its artifact, by going through the same computation; publishes nothing."""
        key = self.key(inputs, parameters)
        if store.find(actor, sequence, self.name, key) is not None:
            return
        shared = store.checkpoint_dir(actor, sequence, self.name, key) / SHARED
        if not shared.is_dir():
            return
        opened = {name: store.open(ref, self.reads[name]) for name, ref in inputs.items()}
        with TemporaryDirectory() as own, suppress(Superseded), _sealed_from_truth():
            shutil.copytree(shared / START, own, dirs_exist_ok=True)
            job = Job(actor, sequence, recording, Path(own), lambda fraction, text: None, lambda text: None, shared=shared)
            self.function(job, **opened, parameters=parameters)

    def as_task(self, store: Store, **circumstances: Any) -> Any:
        """This stage as a Prefect task whose arguments and result are small JSON.

        `task(actor=, sequence=, inputs=, parameters=)` returns a completed state, named Cached where the store had the artifact, whose
        `result()` is {"ref": ..., "cached": bool, "seconds": s}.
        """
        from prefect import task
        from prefect.cache_policies import NO_CACHE
        from prefect.states import Completed, State

        def compute(actor: str, sequence: str, inputs: dict[str, Any], parameters: dict[str, Any]) -> State:
            outcome = self.run(store, actor, sequence, *self._typed(inputs, parameters), **circumstances)
            told = {"ref": outcome.ref.model_dump(mode="json"), "cached": outcome.cached, "seconds": outcome.seconds}
            return Completed(name="Cached" if outcome.cached else "Completed", data=told)

        return task(
            compute,
            name=self.name,
            task_run_name=f"{{actor}} {{sequence}} {self.name}",
            tags=[self.pool],
            cache_policy=NO_CACHE,
            persist_result=False,
            retries=self.retries,
            retry_delay_seconds=5,
            retry_condition_fn=_worth_retrying,
            timeout_seconds=self.timeout_s,
        )

    def _typed(self, inputs: Mapping[str, Any], parameters: Mapping[str, Any]) -> tuple[dict[str, ArtifactRef], Parameters]:
        return {n: ArtifactRef.model_validate(r) for n, r in inputs.items()}, self.parameters.model_validate(dict(parameters))


def stage(
    name: str, *, version: int, pool: str, timeout_s: float = 3600.0, retries: int = 0, spreads: bool = False
) -> Callable[[Callable[..., Record]], Stage]:
    """Declare a stage; `pool` is one of vision, tracking, simulation, rendering. `spreads`: it maps by `job.spread`, so others can help."""

    def declare(function: Callable[..., Record]) -> Stage:
        hints = get_type_hints(function, include_extras=True)
        writes = hints.pop("return")
        hints.pop("job")
        parameters = hints.pop("parameters")
        reads = {name: _record_of(hint) for name, hint in hints.items()}
        return Stage(name, version, pool, timeout_s, retries, function, reads, writes, parameters, spreads)

    return declare


def _opened_to_helpers(checkpoint: Path) -> Path:
    """The folder that helpers look for, with the checkpoint as this run begins from it: theirs must begin from the same."""
    shared, aside = checkpoint / SHARED, checkpoint / f"{SHARED}.tmp"
    shutil.rmtree(aside, ignore_errors=True)
    aside.mkdir()
    for file in (f for f in checkpoint.iterdir() if f.is_file()):
        shutil.copy2(file, aside)
    shared.mkdir(exist_ok=True)
    shutil.rmtree(shared / START, ignore_errors=True)
    aside.rename(shared / START)
    return shared


def _record_of(hint: Any) -> type[Record]:
    """The record class of an input that may be optional."""
    return next(t for t in (hint, *get_args(hint)) if isinstance(t, type) and issubclass(t, Record))


_inside_stage: ContextVar[bool] = ContextVar("inside_stage", default=False)


@contextmanager
def _sealed_from_truth() -> Iterator[None]:
    token = _inside_stage.set(True)
    try:
        yield
    finally:
        _inside_stage.reset(token)


def _refuse_truth(event: str, arguments: tuple) -> None:
    if event != "open" or not isinstance(arguments[0], str) or not _inside_stage.get():
        return
    if SEALED in arguments[0] and any(part.endswith(SEALED) for part in Path(arguments[0]).parts):
        raise PermissionError(f"{arguments[0]}: a stage may not open the truth it is judged by")


sys.addaudithook(_refuse_truth)


def _worth_retrying(task: Any, run: Any, state: Any) -> bool:
    """Bad input stays bad; everything else may be the machine's fault."""
    return not isinstance(state.result(raise_on_failure=False), BadInput)


__all__ = [
    "Count",
    "Folder",
    "Job",
    "ModelFile",
    "NotNegative",
    "Outcome",
    "Parameters",
    "Positive",
    "Stage",
    "content_digest",
    "stage",
]
