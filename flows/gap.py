"""Diagnose recordings of one garment from files: read, diagnose, answer; then predict what is blind and report.

Files held out are not read before the verdict is fixed. One that turns out to be faulty takes nothing along: the answer then makes no claim
on motion kept out.
"""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flows.blind_prediction import BlindPrediction
from flows.gap_inputs import Inputs, Request, held_out, read
from storage_schemas.durable import replace_file
from tasks.child_process import Pool
from tasks.cloth.windows import Recording
from tasks.gap.answer import answer
from tasks.gap.coarse_garment import CoarseGarment, coarse_garment, whole_garment
from tasks.gap.diagnosis import Diagnosis, diagnose
from tasks.gap.time_limit import time_limit
from tasks.geometry.faults import BadInput

LIMIT_S = 1800.0  # of simulating one second
Say = Callable[[str], None]


class Unfinished(RuntimeError):
    """The answer stands; the text says which files could not be made that were asked for beside it, or not be read that were held out, and why."""


def run(
    request: Request,
    *,
    tell: Say = lambda text: None,
    warn: Say = lambda text: None,
    show: Callable[[dict[str, Any]], None] = lambda told: None,
) -> tuple[dict[str, Any], Diagnosis]:
    """The answer as JSON, and what it rests on. `show` is given the answer before anything is predicted or reported.

    Raises BadInput before any work starts, ChildTimedOut or ChildFailed where there is no answer, Unfinished after there is one.
    """
    start = time.perf_counter()
    inputs = read(request)
    for said in inputs.warnings:
        warn(said)
    limit_s, cores = time_limit(LIMIT_S, inputs.recordings, inputs.garment.model.subject.fps), os.cpu_count() or 1
    with Pool(limit_s=limit_s, at_once=cores) as pool:
        work, found, unread = _diagnosed(request, inputs, pool, cores, tell, warn)
        answered = Answered(request, inputs, work, found, work.told(answer(found, seconds=time.perf_counter() - start)), unread)
        try:
            show(answered.told)
        finally:  # files are wanted though nobody looks
            answered.write(pool, tell, warn)
    return answered.told, found


def _diagnosed(
    request: Request, inputs: Inputs, pool: Pool, cores: int, tell: Say, warn: Say
) -> tuple[CoarseGarment, Diagnosis, tuple[str, ...]]:
    """What is diagnosed, what was found, and why files held out could not be read."""
    work, unread = coarse_garment(inputs.garment) if request.quick else whole_garment(inputs.garment), []

    def kept() -> list[Recording]:
        try:
            recordings, warnings = held_out(request, inputs.garment)
        except BadInput as bad:
            unread.append(f"nothing was held out: {bad}")
            return []
        for said in warnings:
            warn(said)
        return [work.recording(r) for r in recordings]

    found = diagnose(
        work.garment.model,
        work.garment.recordings,
        inputs.effects,
        contact_doubt=work.garment.contact_doubt,
        held_out=kept if request.held_out else None,
        quick=request.quick,
        run=pool.map,
        abreast=cores,
        tell=tell,
    )
    return work, found, tuple(unread)


@dataclass(frozen=True)
class Answered:
    """A diagnosis on files that has its answer, `told`; unread: why files held out were not read."""

    request: Request
    inputs: Inputs
    work: CoarseGarment
    found: Diagnosis
    told: dict[str, Any]
    unread: tuple[str, ...] = ()

    def write(self, pool: Pool, tell: Say, warn: Say) -> None:
        """What was asked for beside the answer, each whether or not another could be made. Raises Unfinished."""
        wanted: list[tuple[str, Path | None, Callable[[Path], None]]] = [
            ("blind prediction", self.request.out, lambda out: self._predict(out, pool, warn)),
            ("report", self.request.report, self._report),
        ]
        left = [*self.unread]
        for name, path, make in wanted:
            if path is None:
                continue
            tell(name)
            try:
                make(path)
            except Exception as error:  # noqa: BLE001 - whatever it is, the answer stands and the other file is still wanted
                left.append(f"{name} {path}: could not be made; {type(error).__name__}: {error}")
        if left:
            raise Unfinished("\n".join(left))

    def _predict(self, out: Path, pool: Pool, warn: Say) -> None:
        assert self.inputs.blind is not None  # --out is not taken without --predict
        before = self.work.on_whole(self.found.base)
        after = before if self.found.named is self.found.base else self.work.on_whole(self.found.named)
        for said in BlindPrediction(pool, self.inputs.blind).write(out, before, after):
            warn(said)

    def _report(self, page: Path) -> None:
        """The page, and the answer with its evidence beside it."""
        from tasks.report.gap_page import gap_report, subtitle

        recordings, own = self.work.garment.recordings, not self.request.held_out or bool(self.unread)
        line = subtitle([p.name for p in self.request.tracks], self.told)
        html, numbers = gap_report(self.told, self.found, recordings, title="Gap diagnosis", subtitle=line, own=own)
        replace_file(page, html)
        replace_file(page.with_suffix(".json"), numbers)
