"""The blind check: cases are made, diagnosed by another process that cannot see their truth, and scored. Every case is kept and resumed.

An open exam takes its seed from the user and serves tuning; what other code has answered is asked again. The seed of a sealed one is drawn
from the code that is examined: whoever changes the code gets other questions. Every sealed attempt is added to the scoreboard, and what may
be quoted is the pool of all attempts of a version.

A case is a task: made, diagnosed and answered by rivals on its own. `spread` says where tasks run; their files are the checkpoints, so that
whoever comes next goes on where the last one stopped, wherever that was. What is done counts, however a sitting ends, and a case that fails
keeps no other off.
"""

import hashlib
import json
import math
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from flows import exam_engine
from flows.exam_failures import attempted, name_failed
from flows.exam_folder import OPEN_FILES, Answer, Folder, Row, Say
from flows.exam_process import run_apart
from flows.exam_scoreboard import OWN, SCOREBOARD, entered, entries, result, sat
from storage_schemas.durable import replace_file
from tasks.child_process import ChildFailed, ChildTimedOut, run_in_children
from tasks.exam.generator import other_engine
from tasks.exam.generator.making import Once, make
from tasks.exam.generator.strata import Question, engine_questions, questions
from tasks.exam.generator.subject import Unmakeable
from tasks.exam.rivals.rival import Rival
from tasks.exam.scorer.case import closing, score

ROOT = Path(__file__).parents[1]
EXAMINED = ("tasks/simulator", "tasks/effects", "tasks/cloth", "tasks/gap")
TASK_S = 6 * 3600.0  # of everything about one case, in a child process
THIRD = 3  # slow rivals answer the cases whose number this divides
Split = Literal["open", "sealed"]
Engine = Literal["own", "mujoco"]


@dataclass(frozen=True)
class Exam:
    """A folder, how many cases, their seed, the split, and whose engine moves the cloth; `sealed` takes part of the seed from the examined code."""

    folder: Folder
    count: int
    seed: int
    split: Split
    engine: Engine = OWN

    def questions(self) -> list[Question]:
        """All cases of this exam."""
        seed = self.seed if self.split == "open" else sealed_seed(self.seed)
        return questions(self.count, seed) if self.engine == OWN else engine_questions(self.count, seed, *other_engine.NAMES_AND_OUTSIDE)

    def tasks(self, rivals: Sequence[Rival] = ()) -> "list[Task]":
        """All cases, each with the rivals that answer it."""
        return [Task(self, q, tuple(rival.name for rival in rivals if answers(rival, q.number))) for q in self.questions()]

    def once(self) -> Once | None:
        """What makes a case from one draw, where that is not the generator's own engine."""
        return None if self.engine == OWN else partial(other_engine.make_with, exam_engine.simulate)


@dataclass(frozen=True)
class Task:
    """One case of an exam, the names of the rivals that answer it too, and whether the diagnosis still has to."""

    exam: Exam
    question: Question
    rivals: tuple[str, ...] = ()
    diagnosed: bool = True

    @property
    def candidates(self) -> tuple[str | None, ...]:
        """Who answers it; None is the diagnosis."""
        return (*([None] if self.diagnosed else []), *self.rivals)

    @property
    def answers(self) -> list[Answer]:
        """Those that it asks for."""
        return [(self.question.number, candidate) for candidate in self.candidates]

    def by(self, candidates: Sequence[str | None]) -> "Task":
        """The same, answered by these alone."""
        return replace(self, diagnosed=None in candidates, rivals=tuple(name for name in candidates if name is not None))

    @property
    def done(self) -> bool:
        """Whether nothing is left to do."""
        folder, number = self.exam.folder, self.question.number
        answered = all(folder.answered(*each) for each in self.answers)
        return folder.left_out(number).exists() or (folder.made(number) and answered)


Spread = Callable[[Sequence[Task], Say], None]


def version(root: Path = ROOT) -> str:
    """SHA-256 of the examined code: names and contents of every Python file."""
    digest = hashlib.sha256()
    for file in sorted(p for part in EXAMINED for p in (root / part).rglob("*.py")):
        digest.update(str(file.relative_to(root)).encode() + b"\0" + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def sealed_seed(seed: int, root: Path = ROOT) -> int:
    """Seed of a sealed exam: 63 bits of the hash of the examined code and the user's seed, which only makes further sets."""
    return int.from_bytes(hashlib.sha256(f"{version(root)} {seed}".encode()).digest()[:8], "big") >> 1


def folder_name(seed: int, split: Split, engine: str) -> str:
    """What the folder of an exam is called; a sealed one carries the version that it examines."""
    parts = [split, str(seed), *([version()[:12]] if split == "sealed" else []), *([engine] if engine != OWN else [])]
    return "-".join(parts)


def generate(folder: Folder, wanted: Sequence[Question], once: Once | None = None) -> Iterator[tuple[int, str]]:
    """Make the cases that are not there yet; yields each number and what came of it. What could not be made is not tried again: its draws
    would be the same.
    """
    for question in wanted:
        refused = folder.left_out(question.number)
        if folder.made(question.number):
            yield question.number, "there"
        elif refused.exists():
            yield question.number, f"left out: {refused.read_text().strip()}"
        else:
            yield question.number, _made(folder, question, once, refused)


def _made(folder: Folder, question: Question, once: Once | None, refused: Path) -> str:
    try:
        folder.write(question, make(question, once))
    except Unmakeable as error:
        refused.parent.mkdir(parents=True, exist_ok=True)
        replace_file(refused, f"{error}\n".encode())
        return f"left out: {error}"
    return "made"


def do(task: Task, say: Say) -> None:
    """Make the case, let it be diagnosed, and let its rivals answer it; what is there is kept."""
    folder, number = task.exam.folder, task.question.number
    for _, what in generate(folder, [task.question], task.exam.once()):
        say(f"case {number}: {what}")
    if folder.made(number):
        if task.diagnosed:
            diagnose(folder, number)
        if task.rivals:
            say(f"case {number}: {', '.join(task.rivals)}")
            ask(folder, number, task.rivals)


def tried(task: Task, say: Say) -> bool:
    """Whether a task came to its end; if not, why is told."""
    return attempted(f"case {task.question.number}", partial(do, task, say), say)


def in_turn(tasks: Sequence[Task], say: Say) -> None:
    """One after the other, in this process. Raises RuntimeError, once all have been tried, if any failed."""
    name_failed([task.question.number for task in tasks if not tried(task, say)])


def at_once(count: int, hours: float = math.inf) -> Spread:
    """So many at a time, each in a process of its own: one case is made while another is diagnosed. No case is begun after so many hours.

    Raises RuntimeError, once all have been tried, if any failed.
    """

    def spread(tasks: Sequence[Task], say: Say) -> None:
        left, begin_by = [task for task in tasks if not task.done], time.monotonic() + 3600 * hours
        failed: list[Task] = []
        while left and time.monotonic() < begin_by:
            begun = _apart(left, count, begin_by, say)
            failed += [task for task in left[:begun] if not task.done]
            left = left[begun:]
        name_failed(task.question.number for task in failed)

    return spread


def _apart(tasks: Sequence[Task], count: int, begin_by: float, say: Say) -> int:
    """Work on them in processes of their own; how many were begun. One that dies takes with it those under way, and none is begun after it."""
    begun: set[int] = set()

    def heard(index: int, line: str | None) -> None:
        begun.add(index)
        if line is not None:
            say(line)

    try:
        run_in_children(_tried_apart, [(task,) for task in tasks], limit_s=TASK_S, at_once=count, begin_by=begin_by, on_message=heard)
    except (ChildFailed, ChildTimedOut) as death:
        say(f"{death}; other cases go on, without those that were under way")
        return max(1, len(begun))
    return len(begun)


def _tried_apart(task: Task, say: Callable[[str | None], None]) -> None:
    say(None)  # it has begun
    tried(task, say)


def diagnose(folder: Folder, number: int) -> None:
    """Let `physavatar gap run` answer a case."""
    if not folder.answered(number):
        asked = version()
        options = ["--out", "pred.npz", "--report", "report.html", "--json"]
        with examined(folder, number, ["gap", "run"], options) as (place, text, errors):
            beside = {name: place / name for name in ("pred.npz", "report.html", "report.json")}
            folder.keep_answer(number, None, _parsed(text), by=asked, beside=beside, errors=errors)


def ask(folder: Folder, number: int, rivals: Sequence[str]) -> None:
    """Let rivals answer a case, together: what they share is computed once."""
    left = [name for name in rivals if not folder.answered(number, name)]
    if not left:
        return
    names, asked = [word for name in left for word in ("--name", name)], version()
    with examined(folder, number, ["exam", "rival", *names], ["--out", "."]) as (place, _, errors):
        for name in left:
            told = place / f"{name}.json"
            answer = _parsed(told.read_text() if told.exists() else "")
            folder.keep_answer(number, name, answer, by=asked, beside={"pred.npz": place / f"{name}.npz"}, errors=errors)


@contextmanager
def examined(folder: Folder, number: int, command: Sequence[str], options: Sequence[str]) -> Iterator[tuple[Path, str, str]]:
    """A command on a copy of a case's recordings in a folder of its own, which lasts for the block; with its stdout and stderr."""
    case = folder.case(number)
    withheld = case / "withheld"
    without = [word for name in withheld.read_text().split() for word in ("--without", name)] if withheld.exists() else []
    with tempfile.TemporaryDirectory(prefix="physavatar-exam-") as place:
        for name in OPEN_FILES:
            (Path(place) / name).write_bytes((case / name).read_bytes())
        files = [*OPEN_FILES[:2], "--predict", OPEN_FILES[2]]
        text, errors, _ = run_apart([sys.executable, "-m", "flows.exam_candidate", *command, *files, *options, *without], Path(place))
        yield Path(place), text, errors


def mark(folder: Folder, number: int, rival: str | None = None, before_mm: float | None = None) -> Row:
    """The row of a case that was answered. before_mm: the gap that is to be closed, where it is not that of the answer's own base.

    Raises ValueError if the truth was touched.
    """
    truth, out = folder.truth(number), folder.answer(number, rival)
    answer = json.loads((out / "answer.json").read_text())
    predicted = out / "pred.npz"
    prediction = dict(np.load(predicted, allow_pickle=False)) if answer is not None and predicted.exists() else None
    held_out = dict(np.load(folder.sealed(number) / "held-out.npz", allow_pickle=False))
    return score(truth, answer) | closing(prediction, held_out, truth["floor_mm"] / 1e3, before_mm)


def mark_rivals(exam: Exam, tasks: Sequence[Task], rivals: Sequence[Rival], ours: Sequence[Row]) -> dict[str, list[Row]]:
    """Rows of every rival that answered cases which exist. What any of them closes is told against the diagnosis' prediction without a
    cause, as its own row of the case has it.
    """
    before = {row["number"]: row.get("before_mm") for row in ours}
    by_rival = {r.name: [t.question.number for t in tasks if r.name in t.rivals] for r in rivals}
    return {name: [mark(exam.folder, n, name, before.get(n)) for n in numbers] for name, numbers in by_rival.items()}


def sit(
    exam: Exam, *, rivals: Sequence[Rival] = (), scoreboard: Path = SCOREBOARD, spread: Spread = in_turn, say: Say = lambda _: None
) -> Row:
    """Make, diagnose and score all cases, or those that `spread` gets done, and let rivals answer them.

    Of a sealed exam the attempt is added to the scoreboard, however the sitting ends, and the pool of all attempts of the version returned;
    what the scoreboard has of this version and seed already is not answered again, so that an exam may be sat in parts, on any machine. Of an
    open one what another version answered is asked again. Raises RuntimeError when the examined code of a sealed one was changed meanwhile:
    the answers would be those of no version.
    """
    began = version()
    wanted = exam.tasks(rivals) if exam.split == "open" else unanswered(exam.tasks(rivals), began, scoreboard)
    if exam.split == "open":
        exam.folder.forget_others([answer for task in wanted for answer in task.answers], began, say)
    tell = partial(_told, exam, wanted, rivals, began, scoreboard, say)
    return conducted(exam.split, began, partial(spread, wanted, say), tell)


def conducted(split: Split, began: str, work: Callable[[], object], tell: Callable[[], Row]) -> Row:
    """Do the work of a sitting, and tell what of it is done. Of a sealed one that counts however the work ends, unless the examined code is
    no longer the version that began it: then RuntimeError.
    """
    try:
        work()
    except BaseException:
        if split == "sealed" and version() == began:
            tell()
        raise
    if split == "sealed" and version() != began:
        raise RuntimeError("the examined code was changed during the exam; begin again in another folder")
    return tell()


def _told(exam: Exam, wanted: Sequence[Task], rivals: Sequence[Rival], began: str, scoreboard: Path, say: Say) -> Row:
    """Mark what is done and tell its figures."""
    done = [task for task in wanted if task.done and (exam.split == "sealed" or not exam.folder.answers_of_others(task.answers, began))]
    if len(done) < len(wanted):
        say(f"left for another time: {len(wanted) - len(done)} of {len(wanted)} cases")
    made = [task for task in done if exam.folder.made(task.question.number)]
    left_out = [task.question.number for task in done if task not in made]
    attempt = {"version": began, "seed": exam.seed, "count": exam.count, "engine": exam.engine, "left_out": left_out}
    attempt["cases"] = [mark(exam.folder, task.question.number) for task in made if task.diagnosed]
    ours = [*entries(scoreboard, began, exam.seed, exam.engine), *attempt["cases"]] if exam.split == "sealed" else attempt["cases"]
    attempt["rivals"] = mark_rivals(exam, made, rivals, ours)
    return (entered if done else result)(exam.split, attempt, scoreboard)


def unanswered(tasks: Sequence[Task], of: str, scoreboard: Path) -> list[Task]:
    """The tasks of an exam less what a version's earlier attempts have answered."""
    everyone, exam = {name for task in tasks for name in task.candidates}, tasks[0].exam
    known = {name: sat(scoreboard, of, exam.seed, exam.engine, name) for name in everyone}

    def left(task: Task) -> Task:
        return task.by([name for name in task.candidates if task.question.number not in known[name]])

    return [task for task in map(left, tasks) if task.candidates]


def answers(rival: Rival, number: int) -> bool:
    """Whether a rival answers this case: slow ones answer a third."""
    return not rival.slow or number % THIRD == 0


def _parsed(text: str) -> Row | None:
    """The answer on stdout, whole and thus given, whatever failed after it; None if it is not JSON of version 1."""
    try:
        answer = json.loads(text)
    except ValueError:
        return None
    return answer if isinstance(answer, dict) and answer.get("version") == 1 else None
