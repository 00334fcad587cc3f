"""The blind check: cases are made, diagnosed by another process that cannot see their truth, and scored. Every case is kept and resumed.

    FOLDER/cases/case-0007/           train-1.npz train-2.npz blind.npz truth.sha256 [withheld]     what the diagnosis may read
    FOLDER/answers/case-0007/         answer.json pred.npz stderr.txt                               what it answered
    FOLDER/answers-chance/case-0007/  the same of a rival
    FOLDER/sealed.truth/case-0007/    truth.json held-out.npz                                       what only the scorer opens

An open exam takes its seed from the user and serves tuning. The seed of a sealed one is drawn from the code that is examined: whoever changes
the code gets other questions. Every sealed attempt is added to the scoreboard, and what may be quoted is the pool of all attempts of a version.
"""

import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tasks.exam.generator.making import Made, make
from tasks.exam.generator.strata import Question, questions
from tasks.exam.generator.subject import Unmakeable
from tasks.exam.rivals.rival import Rival
from tasks.exam.scorer.case import closing, score
from tasks.exam.scorer.summary import summary

ROOT = Path(__file__).parents[1]
EXAMINED = ("tasks/simulator", "tasks/effects", "tasks/cloth", "tasks/gap")
SCOREBOARD = ROOT / "docs" / "exam-scoreboard.jsonl"
OPEN_FILES = ("train-1.npz", "train-2.npz", "blind.npz")
UNMADE = "left-out"  # file of a case that could not be made: why
LIMIT_S = 1800  # wall-clock seconds of one diagnosis
THIRD = 3  # slow rivals answer the cases whose number this divides
Split = Literal["open", "sealed"]
Row = dict[str, Any]


class Folder:
    """Where the cases, answers and truths of one exam lie."""

    def __init__(self, root: Path) -> None:
        self.root = Path(root)

    def case(self, number: int) -> Path:
        """What the diagnosis may read."""
        return self.root / "cases" / f"case-{number:04d}"

    def answer(self, number: int, rival: str | None = None) -> Path:
        """What the diagnosis answered, or a rival."""
        return self.root / ("answers" if rival is None else f"answers-{rival}") / f"case-{number:04d}"

    def sealed(self, number: int) -> Path:
        """What only the scorer may read; the ending of the folder above closes it to every diagnosis."""
        return self.root / "sealed.truth" / f"case-{number:04d}"

    def made(self, number: int) -> bool:
        """Whether the case is whole: its seal is written last."""
        return (self.case(number) / "truth.sha256").exists()

    def numbers(self) -> list[int]:
        """The cases that are whole."""
        found = (int(p.name.removeprefix("case-")) for p in sorted((self.root / "cases").glob("case-*")))
        return [n for n in found if self.made(n)]

    def write(self, question: Question, made: Made) -> None:
        """Recordings, then the truth, then the seal."""
        case, sealed = self.case(question.number), self.sealed(question.number)
        case.mkdir(parents=True, exist_ok=True)
        sealed.mkdir(parents=True, exist_ok=True)
        for name, arrays in zip(OPEN_FILES, (*made.recordings, made.blind), strict=True):
            np.savez_compressed(case / name, **arrays)
        np.savez_compressed(sealed / "held-out.npz", **made.held_out)
        _write_json(sealed / "truth.json", made.truth)
        if question.withheld is not None:
            (case / "withheld").write_text(question.withheld + "\n")
        _replace(case / "truth.sha256", seal(sealed) + "\n")

    def truth(self, number: int) -> Row:
        """The truth of a case. Raises ValueError if it is not the one that was sealed."""
        sealed = self.sealed(number)
        if seal(sealed) != (self.case(number) / "truth.sha256").read_text().strip():
            raise ValueError(f"{sealed}: its truth is not what was sealed when the case was made")
        return json.loads((sealed / "truth.json").read_text())


@dataclass(frozen=True)
class Exam:
    """A folder, how many cases, their seed, and the split; `sealed` takes part of the seed from the examined code."""

    folder: Folder
    count: int
    seed: int
    split: Split

    def questions(self) -> list[Question]:
        """All cases of this exam."""
        return questions(self.count, self.seed if self.split == "open" else sealed_seed(self.seed))


def version(root: Path = ROOT) -> str:
    """SHA-256 of the examined code: names and contents of every Python file."""
    digest = hashlib.sha256()
    for file in sorted(p for part in EXAMINED for p in (root / part).rglob("*.py")):
        digest.update(str(file.relative_to(root)).encode() + b"\0" + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def sealed_seed(seed: int, root: Path = ROOT) -> int:
    """Seed of a sealed exam: 63 bits of the hash of the examined code and the user's seed, which only makes further sets."""
    return int.from_bytes(hashlib.sha256(f"{version(root)} {seed}".encode()).digest()[:8], "big") >> 1


def seal(folder: Path) -> str:
    """SHA-256 over the files of a sealed folder, names and contents."""
    digest = hashlib.sha256()
    for file in sorted(folder.iterdir()):
        digest.update(file.name.encode() + b"\0" + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def generate(folder: Folder, wanted: Sequence[Question]) -> Iterator[tuple[int, str]]:
    """Make the cases that are not there yet; yields each number and what came of it. What could not be made is not tried again: its draws would be the same."""
    for question in wanted:
        refused = folder.case(question.number) / UNMADE
        if folder.made(question.number):
            yield question.number, "there"
        elif refused.exists():
            yield question.number, f"left out: {refused.read_text().strip()}"
        else:
            yield question.number, _made(folder, question, refused)


def _made(folder: Folder, question: Question, refused: Path) -> str:
    try:
        folder.write(question, make(question))
    except Unmakeable as error:
        refused.parent.mkdir(parents=True, exist_ok=True)
        _replace(refused, f"{error}\n")
        return f"left out: {error}"
    return "made"


def diagnose(folder: Folder, number: int, rival: str | None = None) -> None:
    """Let `physavatar gap run`, or a rival, answer a case, from a copy of its recordings in a folder of its own."""
    out = folder.answer(number, rival)
    if (out / "answer.json").exists():
        return
    out.mkdir(parents=True, exist_ok=True)
    case = folder.case(number)
    withheld = case / "withheld"
    without = ["--without", withheld.read_text().strip()] if withheld.exists() else []
    with tempfile.TemporaryDirectory(prefix="physavatar-exam-") as place:
        for name in OPEN_FILES:
            (Path(place) / name).write_bytes((case / name).read_bytes())
        command = [
            sys.executable,
            "-m",
            "flows.exam_candidate",
            *(["gap", "run"] if rival is None else ["exam", "rival", rival]),
            *OPEN_FILES[:2],
            "--predict",
            OPEN_FILES[2],
            "--out",
            "pred.npz",
        ]
        began = time.monotonic()
        text, errors, code = _run([*command, *without, "--json"], Path(place))
        answer = _parsed(text) if code == 0 else None
        if answer is not None:
            answer["wall_seconds"] = time.monotonic() - began
        (out / "stderr.txt").write_text(errors)
        predicted = Path(place) / "pred.npz"
        if predicted.exists():
            (out / "pred.npz").write_bytes(predicted.read_bytes())
    _write_json(out / "answer.json", answer)


def mark(folder: Folder, number: int, rival: str | None = None) -> Row:
    """The row of a case that was answered. Raises ValueError if its truth was touched."""
    truth, out = folder.truth(number), folder.answer(number, rival)
    answer = json.loads((out / "answer.json").read_text())
    predicted = out / "pred.npz"
    prediction = dict(np.load(predicted, allow_pickle=False)) if answer is not None and predicted.exists() else None
    held_out = dict(np.load(folder.sealed(number) / "held-out.npz", allow_pickle=False))
    return score(truth, answer) | closing(prediction, held_out, truth["floor_mm"] / 1e3)


def sit(exam: Exam, *, rivals: Sequence[Rival] = (), scoreboard: Path = SCOREBOARD, say: Callable[[str], None] = lambda _: None) -> Row:
    """Make, diagnose and score all cases, then let rivals answer them.

    Of a sealed exam the attempt is added to the scoreboard and the pool of all attempts of the version returned. Raises RuntimeError when the examined
    code was changed meanwhile: the answers would be those of no version.
    """
    wanted, began = exam.questions(), version()
    for number, what in generate(exam.folder, wanted):
        say(f"case {number}: {what}")
        if exam.folder.made(number):
            diagnose(exam.folder, number)
    made = [q.number for q in wanted if exam.folder.made(q.number)]
    left_out = [q.number for q in wanted if q.number not in made]
    if exam.split == "sealed" and version() != began:
        raise RuntimeError("the examined code was changed during the exam; begin again in another folder")
    attempt = {"version": began, "date": datetime.now(UTC).isoformat(timespec="seconds"), "seed": exam.seed, "count": exam.count}
    attempt |= {"left_out": left_out, "cases": [mark(exam.folder, number) for number in made]}
    attempt["rivals"] = {rival.name: _answered(exam.folder, made, rival, say) for rival in rivals}
    if exam.split == "open":
        return _result(exam.split, None, [attempt], left_out)
    scoreboard.parent.mkdir(parents=True, exist_ok=True)
    with scoreboard.open("a") as board:
        board.write(json.dumps(attempt) + "\n")
    return _result(exam.split, attempt["version"], attempts(scoreboard, attempt["version"]), left_out)


def _answered(folder: Folder, numbers: Sequence[int], rival: Rival, say: Callable[[str], None]) -> list[Row]:
    """Rows of a rival: of all cases, or of a third where it is slow."""
    rows = []
    for number in numbers:
        if not rival.slow or number % THIRD == 0:
            say(f"case {number}: {rival.name}")
            diagnose(folder, number, rival.name)
            rows.append(mark(folder, number, rival.name))
    return rows


def attempts(scoreboard: Path, of: str) -> list[Row]:
    """All attempts of a version."""
    lines = scoreboard.read_text().splitlines() if scoreboard.exists() else []
    return [attempt for attempt in map(json.loads, lines) if attempt["version"] == of]


def pooled(attempts: Sequence[Row], rival: str | None = None) -> dict[tuple[int, int], Row]:
    """Rows of all attempts, each case of a seed once, as it was answered first: an exam that was resumed counts once."""
    first: dict[tuple[int, int], Row] = {}  # a longer exam begins with the cases of a shorter one
    for attempt in attempts:
        for row in attempt["cases"] if rival is None else attempt.get("rivals", {}).get(rival, []):
            first.setdefault((attempt["seed"], row["number"]), row)
    return first


def _result(split: Split, of: str | None, attempts: list[Row], left_out: list[int]) -> Row:
    """Figures of the diagnosis; of each rival, its own and the diagnosis' on the cases that it answered."""
    ours = pooled(attempts)
    rivals = {}
    for name in dict.fromkeys(name for attempt in attempts for name in attempt.get("rivals", {})):
        theirs = pooled(attempts, name)
        same = summary([ours[case] for case in theirs])
        rivals[name] = {"cases": len(theirs), "figures": summary(list(theirs.values())), "ours": same, "rows": list(theirs.values())}
    rows = list(ours.values())
    return {
        "split": split,
        "version": of,
        "cases": len(rows),
        "left_out": left_out,
        "figures": summary(rows),
        "rivals": rivals,
        "rows": rows,
    }


def _run(command: list[str], place: Path) -> tuple[str, str, int]:
    """stdout, stderr and exit code of a command run in `place`; 5 when it takes too long."""
    known = {"PATH", "HOME", "LANG", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "NUMBA_CACHE_DIR", "VIRTUAL_ENV"}
    environment = {k: v for k, v in os.environ.items() if k in known} | {"PYTHONPATH": str(ROOT)}
    try:
        ended = subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        return "", f"no answer within {LIMIT_S} s", 5
    return ended.stdout, ended.stderr, ended.returncode


def _parsed(text: str) -> Row | None:
    """The answer on stdout; None if it is not JSON of version 1."""
    try:
        answer = json.loads(text)
    except ValueError:
        return None
    return answer if isinstance(answer, dict) and answer.get("version") == 1 else None


def _write_json(path: Path, value: Any) -> None:
    _replace(path, json.dumps(value, indent=1, sort_keys=True) + "\n")


def _replace(path: Path, text: str) -> None:
    aside = path.with_name(f".{path.name}.{os.getpid()}")
    aside.write_text(text)
    aside.replace(path)
