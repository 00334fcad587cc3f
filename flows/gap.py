"""Diagnose recordings of one garment from files: read, diagnose, read what was held out, predict what is blind."""

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage_schemas.durable import replace_file
from tasks.capture.tracked_geometry import read_tracked_geometry
from tasks.child_process import Pool
from tasks.cloth.windows import Recording
from tasks.effects.effect import Effect
from tasks.effects.library import library, suspects
from tasks.effects.model import Model
from tasks.effects.named import named
from tasks.gap.answer import answer
from tasks.gap.blind import held, predicted
from tasks.gap.coarse_garment import coarse_garment, whole_garment
from tasks.gap.diagnosis import Diagnosis, diagnose
from tasks.gap.garment_recordings import Garment, garment_recordings, recording
from tasks.geometry.faults import BadInput, Fault, refuse

LIMIT_S = 1800.0  # of one window


@dataclass(frozen=True)
class Request:
    """Files of one garment: recordings to learn from, recordings held out, a blind file and where its prediction goes; effects to leave
    out.

    report: HTML page to write; the answer and its evidence go beside it as JSON.
    """

    tracks: tuple[Path, ...]
    held_out: tuple[Path, ...] = ()
    predict: Path | None = None
    out: Path | None = None
    quick: bool = False
    without: tuple[str, ...] = ()
    plugins: Path | None = None
    report: Path | None = None


def run(request: Request, tell: Callable[[str], None] = lambda text: None) -> tuple[dict[str, Any], Diagnosis]:
    """The answer as JSON, and what it rests on. Raises BadInput before any work starts."""
    start = time.perf_counter()
    inputs = read(request)
    for said in inputs.warnings:
        tell(said)
    garment = inputs.garment
    work = coarse_garment(garment) if request.quick else whole_garment(garment)

    def held_out():
        return [work.recording(recording(read_tracked_geometry(p), str(p), garment)) for p in request.held_out]

    cores = os.cpu_count() or 1
    with Pool(limit_s=LIMIT_S, at_once=cores) as pool:
        found = diagnose(
            work.garment.model,
            work.garment.recordings,
            inputs.effects,
            contact_doubt=work.garment.contact_doubt,
            held_out=held_out if request.held_out else None,
            quick=request.quick,
            run=pool.map,
            abreast=cores,
            tell=tell,
        )
        if inputs.blind is not None and request.out is not None:
            tell("blind prediction")
            before = work.on_whole(found.base)
            after = before if found.named is found.base else work.on_whole(found.named)
            BlindPrediction(pool, inputs.blind).write(request.out, before, after)
    told = work.told(answer(found, seconds=time.perf_counter() - start))
    if request.report is not None:
        tell("report")
        _write_report(request.report, request, told, found, work.garment.recordings)
    return told, found


def _write_report(page: Path, request: Request, told: dict[str, Any], found: Diagnosis, recordings: Sequence[Recording]) -> None:
    """The page, and the answer with its evidence beside it."""
    from tasks.report.gap_page import gap_report, subtitle

    line = subtitle([p.name for p in request.tracks], told)
    html, numbers = gap_report(told, found, recordings, title="Gap diagnosis", subtitle=line, own=not request.held_out)
    replace_file(page, html)
    replace_file(page.with_suffix(".json"), numbers)


class BlindPrediction:
    """What models predict of a blind recording; each model is simulated once, however often it is asked for."""

    def __init__(self, pool: Pool, blind: Recording) -> None:
        self._pool, self._blind = pool, blind
        self._known: dict[int, tuple[Model, NDArray[np.float32]]] = {}  # by identity; the model is kept so that its id stays its own

    def write(self, out: Path, before: Model, after: Model) -> None:
        """NPZ of `before` and `after`, [T, V, 3] m, each with its last state held where it ends early; `after` is `before` where it ends the
        earlier: a cause with which cloth cannot be simulated foretells nothing.
        """
        new = [m for k, m in {id(before): before, id(after): after}.items() if k not in self._known]
        moved = self._pool.map(_predicted, [(model, self._blind) for model in new])
        self._known |= {id(model): (model, x.astype(np.float32)) for model, x in zip(new, moved, strict=True)}
        one, other = (held(self._known[id(model)][1], len(self._blind)) for model in (before, after))
        ended = len(self._known[id(after)][1]) < len(self._known[id(before)][1])
        np.savez_compressed(out, before=one, after=one if ended else other)


def _predicted(job):
    return predicted(*job)


@dataclass(frozen=True)
class Inputs:
    """The suspects, the garment with its recordings, the blind recording, and what the files' reader warns of."""

    effects: tuple[Effect, ...]
    garment: Garment
    blind: Recording | None
    warnings: tuple[str, ...]


def read(request: Request) -> Inputs:
    """What a request names. Raises BadInput with everything that is wrong with any of it."""
    tracks, faults, left_out = {}, _faults(request), ()
    known = library(request.plugins)
    try:
        left_out = named(request.without, known, "--without")
    except BadInput as bad:
        faults += bad.faults
    wanted: list[Path] = [*request.tracks, *([request.predict] if request.predict else [])]
    for path in dict.fromkeys(wanted):
        if not path.exists():
            continue
        try:
            tracks[path] = read_tracked_geometry(path)
        except BadInput as bad:
            faults += bad.faults
    refuse(faults)
    unseen = (tracks[request.predict], str(request.predict)) if request.predict else None
    names = list(dict.fromkeys(request.tracks))
    garment = garment_recordings([tracks[p] for p in names], [str(p) for p in names], blind=unseen)
    blind = recording(*unseen, garment, blind=True) if unseen else None
    warnings = tuple(w for p in names for w in tracks[p].warnings)
    return Inputs(tuple(suspects(e for e in known.values() if e not in left_out)), garment, blind, warnings)


def _faults(request: Request) -> list[Fault]:
    """What is wrong with the request, files unread."""
    files: Sequence[Path] = [*request.tracks, *request.held_out, *([request.predict] if request.predict else [])]
    faults = [
        Fault(str(p), "there is no such file or folder", "Give an NPZ of tracked geometry, or a folder of meshes.")
        for p in files
        if not p.exists()
    ]
    if not request.tracks:
        faults.append(Fault("gap run", "names no recording", "Give at least one NPZ or folder."))
    if (request.predict is None) != (request.out is None):
        faults.append(Fault("--predict and --out", "one is given without the other", "Give both."))
    if request.out is not None and not request.out.parent.is_dir():
        faults.append(Fault(f"--out {request.out}", "its folder does not exist", "Create it, or choose another."))
    if request.report is not None and request.report.suffix != ".html":
        faults.append(Fault(f"--report {request.report}", "does not end in .html", "Name an HTML page; its JSON goes beside it."))
    if request.report is not None and not request.report.parent.is_dir():
        faults.append(Fault(f"--report {request.report}", "its folder does not exist", "Create it, or choose another."))
    return faults
