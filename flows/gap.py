"""Diagnose recordings of one garment from files: read, diagnose, read what was held out, predict what is blind."""

import json
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from storage_schemas.durable import replace_file
from tasks.capture.tracked_geometry import read_tracked_geometry
from tasks.child_process import Pool
from tasks.cloth.windows import Recording
from tasks.effects.library import library, suspects
from tasks.gap.answer import answer
from tasks.gap.blind import predicted
from tasks.gap.diagnosis import Diagnosis, diagnose
from tasks.gap.garment_recordings import garment_recordings, recording
from tasks.geometry.faults import BadInput, Fault

LIMIT_S = 1800.0  # of one window


@dataclass(frozen=True)
class Request:
    """Files of one garment: recordings to learn from, recordings held out, a blind file and where its prediction goes; effects to leave out.

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
    _check(request)
    effects = _effects(request)
    garment = garment_recordings([read_tracked_geometry(p) for p in request.tracks], [str(p) for p in request.tracks])
    blind = (
        None if request.predict is None else recording(read_tracked_geometry(request.predict), str(request.predict), garment, blind=True)
    )

    kept = []

    def held_out():
        kept.extend(recording(read_tracked_geometry(p), str(p), garment) for p in request.held_out)
        return kept

    with Pool(limit_s=LIMIT_S, at_once=os.cpu_count() or 1) as pool:
        found = diagnose(
            garment.model,
            garment.recordings,
            effects,
            held_out=held_out if request.held_out else None,
            quick=request.quick,
            run=pool.map,
            tell=tell,
        )
        if blind is not None:
            tell("blind prediction")
            before, after = pool.map(_predicted, [(found.base, blind), (found.named, blind)])
            np.savez_compressed(request.out, before=before.astype(np.float32), after=after.astype(np.float32))
    told = answer(found, seconds=time.perf_counter() - start)
    if request.report is not None:
        tell("report")
        _write_report(request, told, found, garment.recordings, kept or None)
    return told, found


def _write_report(
    request: Request, told: dict[str, Any], found: Diagnosis, recordings: Sequence[Recording], kept: Sequence[Recording] | None
) -> None:
    """The page, and the answer with its evidence beside it."""
    from tasks.gap.account import account, as_json
    from tasks.report.gap_page import gap_page, subtitle

    evidence = account(found, recordings, kept)
    line = subtitle([p.name for p in request.tracks], told)
    html = gap_page(told, found, evidence, title="Gap diagnosis", subtitle=line, own=kept is None)
    replace_file(request.report, html.encode())
    whole = told | {"evidence": as_json(evidence, found)}
    replace_file(request.report.with_suffix(".json"), json.dumps(whole, indent=1, allow_nan=False).encode())


def _predicted(job):
    return predicted(*job)


def _effects(request: Request):
    known = library(request.plugins)
    unknown = [n for n in request.without if n not in known]
    if unknown:
        raise BadInput([Fault("--without", f"there is no effect {n!r}", "See `physavatar effects`.") for n in unknown])
    return suspects(e for name, e in known.items() if name not in request.without)


def _check(request: Request) -> None:
    files: Sequence[Path] = [*request.tracks, *request.held_out, *([request.predict] if request.predict else [])]
    faults = [
        Fault(str(p), "there is no such file or folder", "Give an NPZ of tracked geometry, or a folder of meshes.")
        for p in files
        if not p.exists()
    ]
    if (request.predict is None) != (request.out is None):
        faults.append(Fault("--predict and --out", "one is given without the other", "Give both."))
    if request.out is not None and not request.out.parent.is_dir():
        faults.append(Fault(f"--out {request.out}", "its folder does not exist", "Create it, or choose another."))
    if request.report is not None and request.report.suffix != ".html":
        faults.append(Fault(f"--report {request.report}", "does not end in .html", "Name an HTML page; its JSON goes beside it."))
    if request.report is not None and not request.report.parent.is_dir():
        faults.append(Fault(f"--report {request.report}", "its folder does not exist", "Create it, or choose another."))
    if faults:
        raise BadInput(faults)
