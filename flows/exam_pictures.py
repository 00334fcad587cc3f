"""The blind check from images on: a recording with a planted fault of calibration or body goes through all stages, and what `gap` answers is marked.

    FOLDER/data/case-0003/Sequence1/           pictures, calibration, scan: what the stages may read
    FOLDER/pictures.truth/case-0003/Sequence1/ what the demo's maker keeps to itself; the ending closes it to every stage
    FOLDER/sealed.truth/case-0003/truth.json   what was planted; its SHA-256 is published in cases/case-0003/truth.sha256 before any stage runs
    FOLDER/artifacts/                          the store of the stages
    FOLDER/answers/case-0003/answer.json       what `gap` answered

A calibration that leans is made as gravity that leans: in recorded coordinates the two are one. A body of the wrong size is made as a garment that lies
on more than the skin that is seen. Actors, fabrics, paint and cameras are drawn anew for every case; the dance is the demo's, at another vigour.

Not independent as the generator's cases are: the cloth of these recordings is moved by the simulator that is examined, on another mesh. What they test is
whether a cause survives pictures, tracking and registration. They are never pooled with others (`exam_scoreboard.py`).
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flows.exam import Folder, Split, seal, sealed_seed, version
from flows.exam_scoreboard import PICTURES, SCOREBOARD, result
from storage_schemas.gap import Gap
from storage_schemas.reference import ArtifactRef
from storage_schemas.store import Store
from storage_schemas.tracking import Tracking
from tasks.body.anny_body import build_demo_body
from tasks.body.model import BodyModel
from tasks.capture.demo.dressing import Fitting, Unmodelled, wear
from tasks.capture.demo.garments import locate
from tasks.capture.demo.plan import Plan, Request, make_plan
from tasks.capture.demo.recording import STANDARD, make_demo_recording
from tasks.exam.generator.strata import admissible
from tasks.exam.scorer.case import score

Array = NDArray[np.float64]
Row = dict[str, Any]
Say = Callable[[str], None]

FAULTS = ("gravity_tilt", "body_offset")
TILT = (0.05, 0.085)  # [rad]
OFFSET = (0.008, 0.016)  # [m]
ENERGY = (0.8, 1.2)  # of the dance
SEQUENCE, GARMENT = "Sequence1", "skirt"
UNITS = {"gravity_tilt": "rad", "body_offset": "m"}
ROOT = Path(__file__).parents[1]
LIMIT_S = 2 * 3600


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
            "question": {"number": self.number, "stratum": "single", "twist": "from images", "withheld": None},
            "causes": {self.fault: {"strength": float(np.linalg.norm(self.strengths)), "unit": UNITS[self.fault]}},
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


def sit(folder: Folder, count: int, seed: int, split: Split, *, scoreboard: Path = SCOREBOARD, say: Say = lambda line: None) -> Row:
    """Make the recordings, run all stages on each, and mark what `gap` says; what is there is kept. A sealed attempt goes to the scoreboard.

    Raises RuntimeError when the examined code was changed meanwhile.
    """
    began = version()
    wanted = questions(count, seed if split == "open" else sealed_seed(seed))
    for q in wanted:
        say(f"{q.actor}: recording")
        make(folder, q)
        say(f"{q.actor}: all stages")
        diagnose(folder, q)
    if split == "sealed" and version() != began:
        raise RuntimeError("the examined code was changed during the exam; begin again in another folder")
    attempt = {"version": began, "date": datetime.now(UTC).isoformat(timespec="seconds"), "seed": seed, "count": count}
    attempt |= {"engine": PICTURES, "left_out": [], "cases": [mark(folder, q) for q in wanted], "rivals": {}}
    if split == "sealed":
        scoreboard.parent.mkdir(parents=True, exist_ok=True)
        with scoreboard.open("a") as board:
            board.write(json.dumps(attempt) + "\n")
    return result(split, attempt, scoreboard)


def make(folder: Folder, q: Question) -> None:
    """The sealed truth, then the recording."""
    truth, published = folder.sealed(q.number) / "truth.json", folder.case(q.number) / "truth.sha256"
    if not published.exists():
        for path in (truth, published):
            path.parent.mkdir(parents=True, exist_ok=True)
        truth.write_text(json.dumps(q.as_json(), indent=1) + "\n")
        published.write_text(seal(truth.parent) + "\n")
    where = folder.root / "data", folder.root / "pictures.truth"
    make_demo_recording(*where, cache=_cache(), actor=q.actor, sequence=SEQUENCE, request=q.request, unmodelled=q.unmodelled)


def diagnose(folder: Folder, q: Question) -> None:
    """All stages up to `gap`, as `physavatar submit` runs them, in a process of their own; a run that fails answers nothing."""
    out = folder.answer(q.number) / "answer.json"
    if out.exists():
        return
    out.parent.mkdir(parents=True, exist_ok=True)
    root = folder.root.resolve()
    places = ["--store", str(root / "artifacts"), "--set", f"data={root / 'data'}"]
    command = [sys.executable, "-m", "flows", "submit", q.actor, "--until", "gap", *places, "--json"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    ended = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    (out.parent / "stderr.txt").write_text(ended.stderr)
    found = {}
    if ended.returncode == 0:
        found = json.loads(ended.stdout)
    answer = {"artifacts": found.get("artifacts"), "answer": _verdict(folder, found) if found else None}
    aside = out.with_suffix(f".{os.getpid()}")
    aside.write_text(json.dumps(answer, indent=1) + "\n")
    aside.replace(out)


def _verdict(folder: Folder, run: Row) -> Row:
    """What `gap` answered; its seconds are those of the stage."""
    verdict = _store(folder).open(ArtifactRef.model_validate(run["artifacts"]["gap"]), Gap).verdict
    return {**verdict, "seconds": run["stages"]["gap"]["seconds"]}


def mark(folder: Folder, q: Question) -> Row:
    """The row of a case that was answered; its size is measured now, when nobody can learn from it. Raises ValueError if its truth was touched."""
    truth, told = folder.truth(q.number), json.loads((folder.answer(q.number) / "answer.json").read_text())
    size = folder.answer(q.number) / "size.json"
    if not size.exists():
        size.write_text(json.dumps(_size(folder, q, told)) + "\n")
    return score(truth | json.loads(size.read_text()), told["answer"])


def _size(folder: Folder, q: Question, told: Row) -> Row:
    """magnitude_mm: how far the fault moves the garment; numerics_mm: how far the scan's mesh takes it in its own run; noise_mm: of tracking; multiple."""
    body = BodyModel.load(build_demo_body(_cache()))
    plan, plain = make_plan(q.request, body, q.unmodelled), make_plan(q.request, body, {})
    fitting = plain.fittings[GARMENT]
    truth = folder.root / "pictures.truth" / q.actor / SEQUENCE
    fine = wear(fitting)
    moved = _rms_mm(_arrays(truth / f"{GARMENT}.npz")["vertices"] - fine, fitting.garment.boundary)
    numerics = _numerics_mm(plan, fitting, fine)
    noise = _noise_mm(folder, told, _arrays(truth / "template.npz")["vertices"])
    return {"magnitude_mm": moved, "numerics_mm": numerics, "noise_mm": noise, "multiple": moved / float(np.hypot(numerics, noise))}


def _numerics_mm(plan: Plan, fitting: Fitting, fine: Array) -> float:
    coarse = plan.scanned[GARMENT]
    place = locate(coarse, fitting.garment)
    held = place.of(fine)[:, coarse.boundary]
    run = wear(replace(fitting, garment=coarse, boundary_motion=held))
    return _rms_mm(run - place.of(fine), coarse.boundary)


def _noise_mm(folder: Folder, told: Row, truth: Array) -> float:
    """Error of the tracked garment; 0 where tracking failed."""
    if told["artifacts"] is None:
        return 0.0
    tracking = _store(folder).open(ArtifactRef.model_validate(told["artifacts"]["tracking"]), Tracking)
    own = np.unique(tracking.faces[tracking.part_of_face == tracking.part_names.index(GARMENT)])
    return float(1e3 * np.sqrt(np.mean(np.sum((tracking.vertices[:, own] - truth[:, own]) ** 2, -1))))


def _rms_mm(displacement: Array, driven: NDArray[np.int32]) -> float:
    """Of the vertices that are not driven; displacement [T, V, 3] m."""
    free = np.setdiff1d(np.arange(displacement.shape[1]), driven)
    return float(1e3 * np.sqrt(np.mean(np.sum(displacement[:, free] ** 2, -1))))


def _arrays(path: Path) -> dict[str, Array]:
    return dict(np.load(path, allow_pickle=False))


def _store(folder: Folder) -> Store:
    return Store(folder.root / "artifacts")


def _cache() -> Path:
    return Path(os.environ.get("PHYSAVATAR_CACHE", "~/.cache/physavatar")).expanduser()
