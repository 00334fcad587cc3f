"""The folder of one exam: cases, answers, and truths under a seal.

FOLDER/cases/case-0007/           train-1.npz train-2.npz blind.npz truth.sha256 [withheld]             what the diagnosis may read
FOLDER/answers/case-0007/         answer.json version pred.npz stderr.txt report.html report.json       what it answered, and what that rests on
FOLDER/answers-chance/case-0007/  the same of a rival
FOLDER/sealed.truth/case-0007/    truth.json held-out.npz                                               what only the scorer opens
"""

import hashlib
import json
import shutil
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from storage_schemas.durable import replace_file
from tasks.exam.generator.recording import Made
from tasks.exam.generator.strata import Question
from tasks.geometry.faults import Fault, refuse

OPEN_FILES = ("train-1.npz", "train-2.npz", "blind.npz")
UNMADE = "left-out"  # file of a case that could not be made: why
Row = dict[str, Any]
Say = Callable[[str], None]
Answer = tuple[int, str | None]  # number of its case, and the rival who gave it; None is the diagnosis


class Folder:
    """Where everything of one exam lies."""

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

    def left_out(self, number: int) -> Path:
        """The file that says why a case could not be made."""
        return self.case(number) / UNMADE

    def made(self, number: int) -> bool:
        """Whether the case is whole: its seal is written last."""
        return (self.case(number) / "truth.sha256").exists()

    def answered(self, number: int, rival: str | None = None) -> bool:
        """Whether the diagnosis has answered the case, or a rival."""
        return (self.answer(number, rival) / "answer.json").exists()

    def rests_on(self, number: int) -> str | None:
        """Where the page of the diagnosis lies, seen from this folder; None where no answer to this case brought one."""
        page = self.answer(number) / "report.html"
        return page.relative_to(self.root).as_posix() if page.exists() else None

    def answers_of_others(self, given: Iterable[Answer], of: str) -> list[Answer]:
        """Those that another version of the examined code gave, or one that nobody knows: answers of old had no version beside them."""
        return [each for each in given if self.answered(*each) and self._version(*each) != of]

    def forget_others(self, given: Iterable[Answer], of: str, say: Say) -> None:
        """Drop them: kept, they would be told as answers of this version. Said in a line."""
        old = self.answers_of_others(given, of)
        for each in old:
            shutil.rmtree(self.answer(*each))
        if old:
            say(f"answered by other code, and asked again: {len(old)} answers to cases {', '.join(map(str, sorted({n for n, _ in old})))}")

    def _version(self, number: int, rival: str | None) -> str | None:
        kept = self.answer(number, rival) / "version"
        return kept.read_text().strip() if kept.exists() else None

    def keep_answer(self, number: int, rival: str | None, answer: Row | None, *, by: str, beside: Mapping[str, Path], errors: str) -> None:
        """What was said on stderr, the version that was asked, of the files beside the answer those that were written, then the answer: None
        is one that failed.
        """
        out = self.answer(number, rival)
        out.mkdir(parents=True, exist_ok=True)
        (out / "stderr.txt").write_text(errors)
        (out / "version").write_text(f"{by}\n")
        for name, written in beside.items():
            if written.exists():
                (out / name).write_bytes(written.read_bytes())
        write_json(out / "answer.json", answer)

    def take(self, seed: int) -> None:
        """Make this the folder of a seed's cases. Raises BadInput where it holds another's, which would be told as this one's."""
        kept, other = self.root / "seed", "Give another folder"
        if kept.exists():
            held = kept.read_text().strip()
            what, remedy = f"{self.root} holds the cases of seed {held}", f"{other}, or ask for --seed {held}"
        else:
            held = "unknown" if (self.root / "cases").exists() else str(seed)
            what, remedy = f"{self.root} holds cases of a seed that nobody noted", f"{other}, or write that seed into {kept}"
        refuse([] if held == str(seed) else [Fault(f"--seed {seed}", what, remedy)])
        self.root.mkdir(parents=True, exist_ok=True)
        replace_file(kept, f"{seed}\n".encode())

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
        write_json(sealed / "truth.json", made.truth)
        if question.withheld:
            (case / "withheld").write_text("".join(f"{name}\n" for name in question.withheld))
        self.publish_seal(question.number)

    def publish_seal(self, number: int) -> None:
        """The SHA-256 of what is sealed, beside what may be read."""
        replace_file(self.case(number) / "truth.sha256", f"{seal(self.sealed(number))}\n".encode())

    def truth(self, number: int) -> Row:
        """The truth of a case. Raises ValueError if it is not the one that was sealed."""
        sealed = self.sealed(number)
        if seal(sealed) != (self.case(number) / "truth.sha256").read_text().strip():
            raise ValueError(f"{sealed}: its truth is not what was sealed when the case was made")
        return json.loads((sealed / "truth.json").read_text())


def seal(folder: Path) -> str:
    """SHA-256 over the files of a sealed folder, names and contents."""
    digest = hashlib.sha256()
    for file in sorted(folder.iterdir()):
        digest.update(file.name.encode() + b"\0" + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def write_json(path: Path, value: Any) -> None:
    """The whole file, or none."""
    replace_file(path, (json.dumps(value, indent=1, sort_keys=True) + "\n").encode())
