"""How a sitting ends, what of it counts, and whose answers it tells."""

import json
import shutil
from dataclasses import replace
from functools import partial

import pytest

from flows import exam
from flows.exam_process import Unstarted
from tasks.child_process import ChildFailed
from tasks.exam.rivals.rival import Rival
from tests.exam.conftest import QUESTION


def asked(monkeypatch, *numbers):
    """The exam asks these cases."""
    monkeypatch.setattr(exam.Exam, "questions", lambda self: [replace(QUESTION, number=number) for number in numbers])


def made(folder, *numbers):
    """Copies of case 7 under other numbers."""
    for number in numbers:
        shutil.copytree(folder.case(7), folder.case(number))
        shutil.copytree(folder.sealed(7), folder.sealed(number))
        truth = json.loads((folder.sealed(7) / "truth.json").read_text())
        truth["question"]["number"] = number
        (folder.sealed(number) / "truth.json").write_text(json.dumps(truth))
        folder.publish_seal(number)


def failing(*endings):
    """Instead of `run_apart`: what it does in turn, to answer wrongly where nothing else is given."""
    left = iter(endings)

    def run(command, place):
        ending = next(left, None)
        if ending is not None:
            raise ending
        return "", "", 1

    return run


def board_of(path):
    """Number of every case, line by line."""
    return [[row["number"] for row in json.loads(line)["cases"]] for line in path.read_text().splitlines()] if path.exists() else []


def test_an_open_exam_asks_again_what_other_code_has_answered(folder, monkeypatch):
    """Otherwise a folder would keep the answers of old code for ever, and tell them as today's."""
    calls, said = [], []
    monkeypatch.setattr(exam, "run_apart", lambda command, place: (calls.append(command[3]), ("", "", 1))[1])
    asked(monkeypatch, 7)
    guess = Rival("guess", "guesses", "nobody", lambda case: None)

    def sit():
        exam.sit(exam.Exam(folder, 1, 0, "open"), rivals=[guess], say=said.append)
        return len(calls)

    assert [sit(), sit()] == [2, 2]
    monkeypatch.setattr(exam, "version", lambda: "b" * 64)
    (folder.answer(7) / "pred.npz").write_text("of the old answer")
    assert [sit(), sit()] == [4, 4] and not (folder.answer(7) / "pred.npz").exists()
    assert [line for line in said if "other code" in line] == ["answered by other code, and asked again: 2 answers to cases 7"]
    (folder.answer(7, "guess") / "version").unlink()  # as answers of old
    assert sit() == 5


def test_what_other_code_answers_during_an_open_exam_is_not_told_as_the_answer_of_this(folder, monkeypatch):
    made(folder, 8)
    asked(monkeypatch, 7, 8)
    monkeypatch.setattr(exam, "run_apart", lambda command, place: ("", "", 1))
    versions = iter(["old", "old", "new"])
    monkeypatch.setattr(exam, "version", lambda: next(versions))
    found = exam.sit(exam.Exam(folder, 2, 0, "open"))
    assert found["version"] == "old" and [row["number"] for row in found["rows"]] == [7]


def test_a_sealed_folder_keeps_answers_from_before_versions_lay_beside_them(folder, tmp_path, monkeypatch):
    """Its name holds the version."""
    asked(monkeypatch, 7)
    monkeypatch.setattr(exam, "run_apart", lambda command, place: ("", "", 1))
    exam.diagnose(folder, 7)
    (folder.answer(7) / "version").unlink()
    monkeypatch.setattr(exam, "run_apart", lambda command, place: pytest.fail("it was asked again"))
    assert exam.sit(exam.Exam(folder, 1, 0, "sealed"), scoreboard=tmp_path / "board.jsonl")["cases"] == 1
    assert exam.version()[:12] in exam.folder_name(0, "sealed", "own")


@pytest.mark.parametrize("ending", [KeyboardInterrupt(), Unstarted("flows.gap cannot be imported")])
def test_what_is_done_is_entered_where_the_sitting_is_ended(folder, tmp_path, monkeypatch, ending):
    made(folder, 8, 9)
    asked(monkeypatch, 7, 8, 9)
    monkeypatch.setattr(exam, "run_apart", failing(None, ending))
    board, sitting = tmp_path / "board.jsonl", exam.Exam(folder, 3, 0, "sealed")
    with pytest.raises(type(ending)):
        exam.sit(sitting, scoreboard=board)
    assert board_of(board) == [[7]]
    exam.sit(sitting, scoreboard=board)
    assert board_of(board) == [[7], [8, 9]]


def test_nothing_is_entered_where_the_sitting_is_ended_after_the_code_was_changed(folder, tmp_path, monkeypatch):
    made(folder, 8)
    asked(monkeypatch, 7, 8)
    monkeypatch.setattr(exam, "run_apart", failing(None, KeyboardInterrupt()))
    versions = iter("abcdef")
    monkeypatch.setattr(exam, "version", lambda: next(versions))
    with pytest.raises(KeyboardInterrupt):
        exam.sit(exam.Exam(folder, 2, 0, "sealed"), scoreboard=tmp_path / "board.jsonl")
    assert not (tmp_path / "board.jsonl").exists()


def test_a_case_that_always_fails_keeps_no_other_off(folder, tmp_path, monkeypatch):
    made(folder, 8, 9)
    asked(monkeypatch, 7, 8, 9)
    said, board = [], tmp_path / "board.jsonl"
    for _ in range(2):
        monkeypatch.setattr(exam, "run_apart", failing(RuntimeError("it was killed, and has not answered")))
        with pytest.raises(RuntimeError, match=r"left for another time: 7$"):
            exam.sit(exam.Exam(folder, 3, 0, "sealed"), scoreboard=board, say=said.append)
    assert board_of(board) == [[8, 9]]
    assert sum("case 7: " in line and "it was killed, and has not answered" in line for line in said) == 2


def test_cases_in_processes_of_their_own_go_on_past_one_that_dies(folder, monkeypatch):
    """With it die those that are under way beside it: here 7 and 8 of four, the third of which fails."""
    made(folder, 8, 9, 10)
    monkeypatch.setattr(exam, "run_apart", failing(RuntimeError("it was killed")))
    tasks = [exam.Task(exam.Exam(folder, 4, 0, "open"), replace(QUESTION, number=number)) for number in (7, 8, 9, 10)]
    deaths, said = [ChildFailed("the computation ended by signal SIGKILL before it had a result")], []

    def children(function, arguments, *, at_once, on_message, **_):
        for index, (task,) in enumerate(arguments):
            if deaths:
                on_message(index, None)
                if index == at_once - 1:
                    raise deaths.pop()
            else:
                function(task, partial(on_message, index))

    monkeypatch.setattr(exam, "run_in_children", children)
    with pytest.raises(RuntimeError, match=r"left for another time: 7, 8, 9$"):
        exam.at_once(2)(tasks, said.append)
    assert [folder.answered(number) for number in (7, 8, 9, 10)] == [False, False, False, True]
    assert "SIGKILL" in said[0] and "it was killed" in next(line for line in said if line.startswith("case 9: ") and "there" not in line)
