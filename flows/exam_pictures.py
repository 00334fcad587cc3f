"""The blind check from images on: a recording with a planted fault of calibration or body goes through all stages, and what `gap` answers
is marked.

    FOLDER/data/case-0003/Sequence1/           pictures, calibration, scan: what the stages may read
    FOLDER/pictures.truth/case-0003/Sequence1/ what the demo's maker keeps to itself; the ending closes it to every stage
    FOLDER/sealed.truth/case-0003/truth.json   what was planted; its SHA-256 is published in cases/case-0003/truth.sha256 before any stage runs
    FOLDER/artifacts/                          the store of the stages
    FOLDER/answers/case-0003/answer.json       what `gap` answered

A calibration that leans is made as gravity that leans: in recorded coordinates the two are one. A body of the wrong size is made as a
garment that lies on more than the skin that is seen. Actors, fabrics, paint and cameras are drawn anew for every case; the dance is the
demo's, at another vigour.

Not independent as the generator's cases are: the cloth of these recordings is moved by the simulator that is examined, on another mesh.
What they test is whether a cause survives pictures, tracking and registration. They are never pooled with others (`exam_scoreboard.py`).
"""

import json
import math
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flows.demo import vertices_of
from flows.exam import Split, conducted, sealed_seed, version
from flows.exam_failures import attempted, name_failed
from flows.exam_folder import Folder, Row, Say, write_json
from flows.exam_process import run_apart
from flows.exam_scoreboard import PICTURES, SCOREBOARD, entered, result, sat
from storage_schemas.gap import Gap
from storage_schemas.reference import ArtifactRef
from storage_schemas.store import Store
from storage_schemas.tracking import Tracking
from tasks.body.anny_body import build_demo_body
from tasks.body.model import BodyModel
from tasks.capture.demo.dressing import Unmodelled, wear
from tasks.capture.demo.garments import Garment, locate
from tasks.capture.demo.plan import Request, make_plan
from tasks.capture.demo.recording import STANDARD, make_demo_recording
from tasks.effects.library import library
from tasks.exam.generator.strata import admissible
from tasks.exam.scorer.case import score
from tasks.exam.scorer.demo import vertex_rmse_mm

Array = NDArray[np.float64]

FAULTS = ("gravity_tilt", "body_offset")
TILT = (0.05, 0.085)  # [rad]
OFFSET = (0.008, 0.016)  # [m]
ENERGY = (0.8, 1.2)  # of the dance
SEQUENCE, GARMENT = "Sequence1", "skirt"


@dataclass(frozen=True)
class Question:
    """One case before it is made: the recording asked for, and the fault with its strengths in SI units."""

    number: int
    request: Request
    fault: str
    strengths: tuple[float, ...]

    @property
    def unmodelled(self) -> Unmodelled:
        """As the demo's maker takes it."""
        return {self.fault: self.strengths}

    @property
    def actor(self) -> str:
        """Name of the actor, and of the case."""
        return f"case-{self.number:04d}"

    def as_json(self) -> Row:
        """The truth."""
        return {
            "question": {"number": self.number, "stratum": "single", "twist": "from images", "withheld": []},
            "causes": {self.fault: {"strength": float(np.linalg.norm(self.strengths)), "unit": library()[self.fault].strengths[0].unit}},
            "components": list(self.strengths),
            "admissible": {self.fault: sorted(admissible(self.fault))},
            "local": False,
        }


def questions(count: int, seed: int, *, size: Request = STANDARD) -> list[Question]:
    """`count` cases, faults in turn; size: cameras, frames and pictures of each."""
    return [_question(number, seed, size) for number in range(count)]


def _question(number: int, seed: int, size: Request) -> Question:
    rng = np.random.default_rng([seed, number])
    fault, angle = FAULTS[number % len(FAULTS)], rng.uniform(0, 2 * np.pi)
    request = replace(size, seed=int(rng.integers(2**31)), energy=float(rng.uniform(*ENERGY)))
    if fault == "gravity_tilt":
        lean = rng.uniform(*TILT)
        return Question(number, request, fault, (float(lean * np.cos(angle)), float(lean * np.sin(angle))))
    return Question(number, request, fault, (float(rng.uniform(*OFFSET)),))


def sit(
    folder: Folder,
    count: int,
    seed: int,
    split: Split,
    *,
    hours: float = math.inf,
    scoreboard: Path = SCOREBOARD,
    say: Say = lambda line: None,
) -> Row:
    """Make the recordings, run all stages on each, and mark what `gap` says; none is begun after so many hours. A sealed attempt goes to the
    scoreboard, however the sitting ends, and what that has of the version is not done again; of an open one what another version answered is.

    Raises RuntimeError when the examined code was changed meanwhile, or, once all have been tried, if any case failed.
    """
    began, end = version(), time.monotonic() + 3600 * hours
    known = sat(scoreboard, began, seed, PICTURES) if split == "sealed" else set()
    wanted = [q for q in questions(count, seed if split == "open" else sealed_seed(seed)) if q.number not in known]
    if split == "open":
        folder.forget_others([(q.number, None) for q in wanted], began, say)

    def tell() -> Row:
        done = [
            q
            for q in wanted
            if folder.answered(q.number) and (split == "sealed" or not folder.answers_of_others([(q.number, None)], began))
        ]
        if len(done) < len(wanted):
            say(f"left for another time: {len(wanted) - len(done)} of {len(wanted)} cases")
        attempt = {"version": began, "seed": seed, "count": count, "engine": PICTURES, "left_out": []}
        return (entered if done else result)(split, attempt | {"cases": [mark(folder, q) for q in done], "rivals": {}}, scoreboard)

    return conducted(split, began, partial(_in_turn, folder, wanted, end, say), tell)


def _in_turn(folder: Folder, wanted: Sequence[Question], end: float, say: Say) -> None:
    """One after the other, none begun after `end` on the clock of `time.monotonic`."""
    begun = (q for q in wanted if time.monotonic() < end)
    name_failed([q.number for q in begun if not attempted(q.actor, partial(_do, folder, q, say), say)])


def _do(folder: Folder, q: Question, say: Say) -> None:
    say(f"{q.actor}: recording")
    make(folder, q)
    say(f"{q.actor}: all stages")
    diagnose(folder, q)


def make(folder: Folder, q: Question) -> None:
    """The sealed truth, then the recording."""
    if not folder.made(q.number):
        for place in (folder.sealed(q.number), folder.case(q.number)):
            place.mkdir(parents=True, exist_ok=True)
        write_json(folder.sealed(q.number) / "truth.json", q.as_json())
        folder.publish_seal(q.number)
    where = folder.root / "data", folder.root / "pictures.truth"
    make_demo_recording(*where, cache=_cache(), actor=q.actor, sequence=SEQUENCE, request=q.request, unmodelled=q.unmodelled)


def diagnose(folder: Folder, q: Question) -> None:
    """All stages up to `gap`, as `physavatar submit` runs them, in a process of their own; a run that fails or takes too long answers nothing."""
    if folder.answered(q.number):
        return
    root, asked = folder.root.resolve(), version()
    places = ["--store", str(root / "artifacts"), "--set", f"data={root / 'data'}"]
    text, errors, code = run_apart([sys.executable, "-m", "flows", "submit", q.actor, "--until", "gap", *places, "--json"], root)
    told = {"artifacts": None, "answer": None}
    if code == 0:
        run = json.loads(text)
        verdict = _store(folder).open(ArtifactRef.model_validate(run["artifacts"]["gap"]), Gap).verdict
        told = {"artifacts": run["artifacts"], "answer": {**verdict, "seconds": run["stages"]["gap"]["seconds"]}}
    folder.keep_answer(q.number, None, told, by=asked, beside={}, errors=errors)


def mark(folder: Folder, q: Question) -> Row:
    """The row of a case that was answered; its size is measured now, when nobody can learn from it. Raises ValueError if its truth was touched."""
    truth, told = folder.truth(q.number), json.loads((folder.answer(q.number) / "answer.json").read_text())
    size = folder.answer(q.number) / "size.json"
    if not size.exists():
        write_json(size, _size(folder, q, told))
    return score(truth | json.loads(size.read_text()), told["answer"])


def _size(folder: Folder, q: Question, told: Row) -> Row:
    """magnitude_mm: how far the fault moves the garment; numerics_mm: how far the scan's mesh takes it in its own run; noise_mm: of tracking; multiple."""
    plan = make_plan(q.request, BodyModel.load(build_demo_body(_cache())), {})
    fitting, coarse = plan.fittings[GARMENT], plan.scanned[GARMENT]
    truth = folder.root / "pictures.truth" / q.actor / SEQUENCE
    fine = wear(fitting)
    moved = vertex_rmse_mm(_vertices(truth / f"{GARMENT}.npz"), fine, of=_free(fitting.garment))
    on_coarse = locate(coarse, fitting.garment).of(fine)
    run = wear(replace(fitting, garment=coarse, boundary_motion=on_coarse[:, coarse.boundary]))
    numerics = vertex_rmse_mm(run, on_coarse, of=_free(coarse))
    noise = _noise_mm(folder, told, _vertices(truth / "template.npz"))
    return {"magnitude_mm": moved, "numerics_mm": numerics, "noise_mm": noise, "multiple": moved / float(np.hypot(numerics, noise))}


def _noise_mm(folder: Folder, told: Row, truth: Array) -> float:
    """Error of the tracked garment; 0 where tracking failed."""
    if told["artifacts"] is None:
        return 0.0
    tracking = _store(folder).open(ArtifactRef.model_validate(told["artifacts"]["tracking"]), Tracking)
    return vertex_rmse_mm(tracking.vertices, truth, of=vertices_of(tracking, GARMENT))


def _free(garment: Garment) -> NDArray[np.bool_]:
    """Vertices [V] that are not driven: those that are lie alike in every run."""
    return ~np.isin(np.arange(len(garment.vertices)), garment.boundary)


def _vertices(path: Path) -> Array:
    return np.load(path, allow_pickle=False)["vertices"]


def _store(folder: Folder) -> Store:
    return Store(folder.root / "artifacts")


def _cache() -> Path:
    return Path(os.environ.get("PHYSAVATAR_CACHE", "~/.cache/physavatar")).expanduser()
