"""From the words of the command line to a run: resolve, check everything that can be checked, run, and tell how it ended."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console

from flows.actor import run_actor
from flows.config import load
from flows.demo import DEMO, compare_with_truth, ensure_demo
from flows.endings import Refused, ending_of, state_of
from flows.pipeline import AVATAR, STAGES
from flows.preflight import preflight
from flows.progress import bars
from flows.request import Planned, Request, plan_actor, tell_kept_warnings
from flows.runs import RunRecord
from storage_schemas.durable import require_room
from storage_schemas.object_store import open_store
from storage_schemas.reference import ArtifactRef, validate_name
from storage_schemas.store import Store
from tasks.geometry.faults import BadInput, Fault

ROOM = 32_000_000  # [bytes] for Prefect's database and the run's record: without it Prefect's server dies and says nothing for minutes


@dataclass(frozen=True)
class Ended:
    """A run that went through: its artifacts and where the report lies."""

    record: RunRecord
    artifacts: dict[str, ArtifactRef]
    report: Path | None
    scores: dict[str, Any] | None

    def as_json(self) -> dict[str, Any]:
        """What --json prints."""
        run = self.record.as_json()
        return {
            "run": run["id"],
            "state": run["state"],
            "stages": run["stages"],
            "artifacts": {n: r.model_dump(mode="json") for n, r in self.artifacts.items()},
            "report": str(self.report) if self.report else None,
            "scores": self.scores,
        }

    def show(self, console: Console) -> None:
        """What a person wants to see at the end."""
        computed = [n for n, s in self.record.stages.items() if s["state"] == "completed"]
        console.print(f"computed: {', '.join(computed) or 'nothing, all was in the store'}", highlight=False)
        for name, score in (self.scores or {}).items():
            value = "not estimated" if score["value"] is None else f"{score['value']:.3g} {score['unit'].replace('1', '')}"
            console.print(f"  {name}: {value}", highlight=False)
        if self.report:
            console.print(f"report: {self.report}", highlight=False, soft_wrap=True)


@dataclass(frozen=True)
class Submission:
    """One request, ready to run or to plan."""

    request: Request
    store: Store
    console: Console

    @classmethod
    def prepare(
        cls,
        actor: str,
        sequence: str | None,
        *,
        until: str,
        overrides: Sequence[str],
        store: Path | str | None,
        console: Console,
        makes: bool = True,
    ) -> "Submission":
        """Resolve names and settings; refuses what cannot be, before any work. makes: the demo's recording and the store, where they are not
        there yet."""
        validate_name(actor, "actor")
        if until not in STAGES:
            raise Refused(f"there is no stage {until!r}; the stages are {', '.join(STAGES)}")
        settings = load(overrides, places={"store": store})
        if actor == DEMO and makes:
            ensure_demo(Path(settings.data), settings.demo, console)
        if settings.capture.recording is None:
            sequence, recording = _find_recording(Path(settings.data), actor, sequence)
            settings = load([*overrides, f"capture.recording={recording}"], places={"store": store})
        else:  # it lies elsewhere, under any name
            sequence = sequence or Path(settings.capture.recording).name
            validate_name(sequence, "sequence")
        opened = open_store(settings.store, founds=makes)
        scores = partial(compare_with_truth, Path(settings.data), opened) if actor == DEMO else lambda artifacts: None
        return cls(Request(actor, sequence, settings, AVATAR, until, scores), opened, console)

    def check(self) -> list[Planned]:
        """The stages as they would run. Raises what `run` would before any of them starts."""
        planned = plan_actor(self.request, self.store)
        if not all(stage.cached for stage in planned):
            require_room(self.store.root, ROOM)
            preflight(self.request.settings, self.request.until)
        return planned

    def run(self) -> Ended:
        """Run to the end; the run record keeps how it ended, whatever happens. Bad input is found before any stage starts."""
        planned = self.check()
        complete = all(stage.cached for stage in planned)
        record = RunRecord(self.store.root, self.request.actor, self.request.sequence)
        try:
            with bars(record, self.console):
                artifacts = self._found(planned, record) if complete else run_actor(self.request, self.store, record)
        except BaseException as error:
            record.end(state_of(error), ending_of(error)[1].splitlines()[0] if ending_of(error)[1] else None)
            raise
        record.end("completed")
        report = self.store.folder(artifacts["report"]) / "files" / "report.html" if "report" in artifacts else None
        return Ended(record, artifacts, report, self.request.scores(artifacts))

    def _found(self, planned: list[Planned], record: RunRecord) -> dict[str, ArtifactRef]:
        """All artifacts are there: no flow, no server."""
        found = {}
        for stage in planned:
            ref = self._ref(stage)
            if ref is None or stage.key is None:
                raise Refused(f"the artifact of {stage.stage} has been removed since it was looked for: submit again")
            with record.stage(stage.stage, stage.key) as report:
                found[stage.stage] = ref
                self.store.set_latest(ref)
                tell_kept_warnings(report, STAGES[stage.stage], ref, self.store)
                report.done(cached=True, seconds=0.0)
        return found

    def _ref(self, planned: Planned) -> ArtifactRef | None:
        """The artifact that a plan has found, if it is still there."""
        return None if planned.key is None else self.store.find(self.request.actor, self.request.sequence, planned.stage, planned.key)

    def forget_from(self, stage: str) -> None:
        """Remove the artifacts that this request would find for `stage` and all that is made from it, so that they are computed anew."""
        if stage not in STAGES:
            raise Refused(f"there is no stage {stage!r}; the stages are {', '.join(STAGES)}")
        gone = {stage}
        for planned in plan_actor(self.request, self.store):
            ref = self._ref(planned)
            if ref is not None and gone & {planned.stage, *(made_from.stage for made_from in self.store.provenance(ref).inputs.values())}:
                gone.add(planned.stage)
                self.store.retire(ref)


def _find_recording(data: Path, actor: str, sequence: str | None) -> tuple[str, Path]:
    folder = data / actor
    if not folder.is_dir():
        known = sorted(p.name for p in data.glob("*") if p.is_dir() and not p.name.endswith(".truth")) if data.is_dir() else []
        remedy = (
            f"Known there: {', '.join(known)}."
            if known
            else "Put recordings below it as <actor>/<sequence>, or set `data`; `demo` is made on first use."
        )
        raise BadInput([Fault(str(folder), "there is no such actor", remedy)])
    known = sorted(p.name for p in folder.iterdir() if p.is_dir())
    if sequence is None and len(known) == 1:
        sequence = known[0]
    if sequence is None:
        raise BadInput([Fault(str(folder), f"it has {len(known)} sequences: {', '.join(known) or 'none'}", "Name one with --sequence.")])
    validate_name(sequence, "sequence")
    if sequence not in known:
        raise BadInput([Fault(str(folder / sequence), "there is no such sequence", f"Known there: {', '.join(known) or 'none'}.")])
    return sequence, folder / sequence
