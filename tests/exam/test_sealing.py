"""The truth is sealed, the examined process cannot open it, and the scoreboard only grows."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from flows import exam, exam_scoreboard
from flows.exam_candidate import closed
from flows.exam_folder import OPEN_FILES, Folder, seal
from flows.exam_process import run_apart
from tasks.exam.rivals.rival import Rival
from tests.exam.conftest import QUESTION

ROOT = Path(__file__).parents[2]
ANSWER = {
    "version": 1,
    "verdict": {"kind": "none", "effects": [], "class": [], "probability": 1.0},
    "ranking": [{"class": ["none"], "probability": 1.0, "strength": {}}],
    "answer_set_90": ["none"],
    "where": {},
    "seconds": 1.0,
}


def test_the_published_seal_is_that_of_the_truth(folder):
    assert (folder.case(7) / "truth.sha256").read_text().strip() == seal(folder.sealed(7))
    assert folder.truth(7)["causes"] == {"air_lift": {"strength": 5.0, "unit": "m2/kg"}}


@pytest.mark.parametrize("file", ["truth.json", "held-out.npz"])
def test_a_truth_that_was_touched_is_refused(folder, file):
    with (folder.sealed(7) / file).open("ab") as f:
        f.write(b" ")
    with pytest.raises(ValueError, match="not what was sealed"):
        folder.truth(7)


def test_what_the_diagnosis_gets_holds_no_truth(folder):
    for file in folder.case(7).iterdir():
        assert file.name in {*OPEN_FILES, "truth.sha256", "withheld"}


def test_an_examined_process_opens_neither_truth_nor_exam(folder):
    attempts = {
        f"open({str(folder.sealed(7) / 'truth.json')!r})": True,
        f"__import__('os').listdir({str(folder.sealed(7))!r})": True,
        f"__import__('pathlib').Path({str(folder.sealed(7) / 'truth.json')!r}).read_bytes()": True,
        "__import__('tasks.exam.generator.causes')": True,
        f"__import__('subprocess').run(['cat', {str(folder.sealed(7) / 'truth.json')!r}])": True,
        f"open({str(folder.case(7) / 'truth.sha256')!r})": False,
    }
    script = "import sys; from flows.exam_candidate import closed; sys.addaudithook(closed)\n"
    for attempt, refused in attempts.items():
        ended = subprocess.run([sys.executable, "-c", script + attempt], cwd=ROOT, capture_output=True, text=True, check=False)
        assert ("PermissionError" in ended.stderr) == refused, attempt + ended.stderr


def test_the_hook_looks_at_bytes_too():
    with pytest.raises(PermissionError):
        closed("open", (b"/somewhere/sealed.truth/x", "r", 0))


TRYING = """
import sys, types

def opening(path):
    try:
        return open(path).read()
    except PermissionError:
        return "refused"

def main():
    from sitecustomize import opening
    from tasks.child_process import Pool
    with Pool(limit_s=60, at_once=1) as pool:
        print("here", opening({path!r}), "child", *pool.map(opening, [{path!r}]))

sys.modules["flows.gap"], sys.modules["flows.cli"] = types.ModuleType("flows.gap"), types.SimpleNamespace(main=main)
"""


def test_whatever_the_command_line_does_is_under_the_hook_and_so_are_its_processes(folder, tmp_path):
    truth = folder.sealed(7) / "truth.json"
    (tmp_path / "sitecustomize.py").write_text(TRYING.format(path=str(truth)))
    ended = subprocess.run(
        [sys.executable, "-m", "flows.exam_candidate", "gap", "run"],
        cwd=tmp_path,
        env={"PYTHONPATH": f"{tmp_path}:{ROOT}", "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.stdout == "here refused child refused\n", ended.stdout + ended.stderr


def test_the_command_line_works_under_the_hook(tmp_path):
    ended = subprocess.run(
        [sys.executable, "-m", "flows.exam_candidate", "gap", "--help"],
        cwd=tmp_path,
        env={"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr


def test_the_sealed_seed_follows_the_examined_code(tmp_path):
    for part in exam.EXAMINED:
        (tmp_path / part).mkdir(parents=True)
    code = tmp_path / exam.EXAMINED[-1] / "verdict.py"
    code.write_text("x = 1\n")
    before = exam.sealed_seed(0, tmp_path)
    assert exam.sealed_seed(0, tmp_path) == before != exam.sealed_seed(1, tmp_path)
    code.write_text("x = 2\n")
    assert exam.sealed_seed(0, tmp_path) != before


def test_a_diagnosis_that_fails_is_a_wrong_answer_not_a_missing_case(folder, monkeypatch):
    monkeypatch.setattr(exam, "run_apart", lambda command, place: ("", "it broke", 1))
    exam.diagnose(folder, 7)
    row = exam.mark(folder, 7)
    assert row["failed"] and row["credit"] == 0
    assert (folder.answer(7) / "stderr.txt").read_text() == "it broke"


@pytest.mark.parametrize("told", [json.dumps(ANSWER), json.dumps(ANSWER)[:-9]])
def test_an_answer_stands_once_it_is_given_whole(folder, monkeypatch, told):
    """`gap run` tells it before the blind prediction, and ends with 1 where only that could not be made."""
    monkeypatch.setattr(exam, "run_apart", lambda command, place: (told, "blind prediction: could not be made", 1))
    exam.diagnose(folder, 7)
    row, whole = exam.mark(folder, 7), told.endswith("}")
    assert row["failed"] != whole and row["kind"] == ("none" if whole else "failed")
    assert "after_mm" not in row


@pytest.mark.parametrize("ask", [exam.diagnose, lambda folder, number: exam.ask(folder, number, ["chance"])])
def test_code_that_cannot_be_imported_has_not_answered(folder, monkeypatch, tmp_path, ask):
    """Of a version that lacked a name, 134 cases were once told as failed by rivals that had never begun."""
    (tmp_path / "sitecustomize.py").write_text("import sys; sys.modules['tasks.gap.blind'] = None\n")
    path = f"PYTHONPATH={tmp_path}:{ROOT}"
    monkeypatch.setattr(exam, "run_apart", lambda command, place: run_apart(["env", path, *command], place))
    with pytest.raises(RuntimeError, match=r"(?s)could not be started, and has not answered.*tasks\.gap\.blind"):
        ask(folder, 7)
    assert not any(folder.answered(7, candidate) for candidate in (None, "chance"))


@pytest.mark.parametrize(("does", "how"), [("kill $$", "ended from outside"), ("kill -9 $$", "was killed"), ("exit 4", "cancelled")])
def test_a_process_that_somebody_ended_has_not_answered(folder, monkeypatch, does, how):
    monkeypatch.setattr(exam, "run_apart", lambda _, place: run_apart(["bash", "-c", does], place))
    with pytest.raises(RuntimeError, match=how):
        exam.diagnose(folder, 7)
    assert not folder.answered(7)


def test_withheld_effects_are_left_out_and_answers_are_kept(folder, monkeypatch):
    calls = []

    def run(command, place):
        calls.append(command)
        assert sorted(p.name for p in place.iterdir()) == sorted(OPEN_FILES)
        for name in (command[command.index("--report") + 1], "report.json"):
            (place / name).write_text(name)
        return "{}", "", 0

    monkeypatch.setattr(exam, "run_apart", run)
    exam.diagnose(folder, 7)
    exam.diagnose(folder, 7)
    assert len(calls) == 1
    kept = {file.name: file.read_text() for file in folder.answer(7).iterdir() if file.name != "answer.json"}
    rests_on = {"report.html": "report.html", "report.json": "report.json", "stderr.txt": ""}
    assert kept == rests_on | {"version": f"{exam.version()}\n"}
    assert [name for word, name in pairwise(calls[0]) if word == "--without"] == ["air_lift", "air_wind"]


def test_a_case_that_cannot_be_made_is_not_tried_again(tmp_path, monkeypatch):
    tried = []

    def make(question, once):
        tried.append(question.number)
        raise exam.Unmakeable("two meshes of it differ by 12 mm")

    monkeypatch.setattr(exam, "make", make)
    folder = Folder(tmp_path / "new")
    told = [list(exam.generate(folder, [QUESTION])) for _ in range(2)]
    assert told == [[(7, "left out: two meshes of it differ by 12 mm")]] * 2
    assert tried == [7] and folder.numbers() == [] and not folder.made(7)


def test_a_sealed_exam_is_sat_in_parts_and_pooled(folder, tmp_path, monkeypatch):
    """What the scoreboard has of a version and seed is not answered again, in whichever folder, nor made."""
    calls = []
    monkeypatch.setattr(exam, "run_apart", lambda command, place: (calls.append(command), ("", "", 1))[1])
    monkeypatch.setattr(exam.Exam, "questions", lambda self: [QUESTION, replace(QUESTION, number=8)][: self.count])
    board = tmp_path / "board.jsonl"
    exam.sit(exam.Exam(folder, 1, 0, "sealed"), scoreboard=board)
    elsewhere = Folder(tmp_path / "elsewhere")
    assert exam.sit(exam.Exam(elsewhere, 1, 0, "sealed"), scoreboard=board)["cases"] == 1
    assert len(board.read_text().splitlines()) == len(calls) == 1 and not elsewhere.made(7)
    monkeypatch.setattr(exam, "make", refused)
    result = exam.sit(exam.Exam(elsewhere, 2, 0, "sealed"), scoreboard=board)
    exam.sit(exam.Exam(elsewhere, 2, 0, "sealed"), scoreboard=board)  # what cannot be made is not tried again either
    first, second = (json.loads(line) for line in board.read_text().splitlines())
    assert [row["number"] for row in first["cases"]] == [7] and second["cases"] == [] and second["left_out"] == [8]
    assert first["version"] == second["version"] == exam.version() and result["cases"] == 1 and result["left_out"] == [8]
    monkeypatch.setattr(
        exam.Exam, "questions", lambda self: [QUESTION, replace(QUESTION, number=8), replace(QUESTION, number=9)][: self.count]
    )
    third = exam.sit(exam.Exam(elsewhere, 3, 0, "sealed"), scoreboard=board)
    assert third["left_out"] == [8, 9]  # of all parts, as the figures are
    exam.sit(exam.Exam(folder, 1, 1, "sealed"), scoreboard=board)  # another set
    assert len(board.read_text().splitlines()) == 4
    assert not exam_scoreboard.attempts(board, "another version")


def test_what_was_not_done_is_neither_marked_nor_left_out(folder, tmp_path, monkeypatch):
    """A case that a rival has still to answer is not done either."""
    monkeypatch.setattr(exam, "run_apart", lambda command, place: ("", "", 1))
    monkeypatch.setattr(exam, "make", refused)
    monkeypatch.setattr(exam.Exam, "questions", lambda self: [replace(QUESTION, number=number) for number in (7, 8, 9)])
    board, said = tmp_path / "board.jsonl", []

    def sit(spread):
        guess = Rival("guess", "guesses", "nobody", lambda case: None)
        return exam.sit(exam.Exam(folder, 3, 0, "sealed"), rivals=[guess], scoreboard=board, spread=spread, say=said.append)

    assert sit(lambda tasks, say: exam.do(tasks[0].by([None]), print))["cases"] == 0
    assert folder.answered(7) and not board.exists() and said.pop() == "left for another time: 3 of 3 cases"
    sit(lambda tasks, say: exam.in_turn(tasks[:2], print))
    assert said.pop() == "left for another time: 1 of 3 cases"
    sit(exam.in_turn)
    told = [json.loads(line) for line in board.read_text().splitlines()]
    assert [[row["number"] for row in line["cases"]] for line in told] == [[7], []]
    assert [line["left_out"] for line in told] == [[8], [9]]


def test_hours_end_when_they_have_passed(folder, monkeypatch):
    heard, clock = {}, iter([1000.0, 1000.0, 2800.0])
    monkeypatch.setattr(exam, "run_in_children", lambda function, arguments, **options: heard.update(options))
    monkeypatch.setattr(exam.time, "monotonic", lambda: next(clock))
    exam.at_once(2, 0.5)([exam.Task(exam.Exam(folder, 1, 0, "open"), QUESTION)], print)
    assert heard["begin_by"] == 2800.0


def refused(question, once):
    raise exam.Unmakeable("two meshes of it differ by 12 mm")


def test_rivals_may_come_later(folder, tmp_path, monkeypatch):
    calls = []
    monkeypatch.setattr(exam, "run_apart", lambda command, place: (calls.append(command[3:5]), ("", "", 1))[1])
    monkeypatch.setattr(exam.Exam, "questions", lambda self: [QUESTION])
    board, sitting = tmp_path / "board.jsonl", exam.Exam(folder, 1, 0, "sealed")
    guess = Rival("guess", "guesses", "nobody", lambda case: None)
    for rivals in ([], [guess], [guess]):
        result = exam.sit(sitting, rivals=rivals, scoreboard=board)
    assert calls == [["gap", "run"], ["exam", "rival"]]
    assert [len(json.loads(line)["cases"]) for line in board.read_text().splitlines()] == [1, 0]
    assert result["rivals"]["guess"]["ours"] == result["figures"]


def test_cases_of_every_version_are_told_together(folder, tmp_path, monkeypatch):
    """A version's case of a number is not another version's; a case that one version sat twice is one; other engines' are apart."""
    monkeypatch.setattr(exam, "run_apart", lambda command, place: ("", "", 1))
    monkeypatch.setattr(exam.Exam, "questions", lambda self: [QUESTION])
    board = tmp_path / "board.jsonl"
    exam.sit(exam.Exam(folder, 1, 0, "sealed"), scoreboard=board)
    (line,) = (json.loads(text) for text in board.read_text().splitlines())
    with board.open("a") as file:
        for changed in ({"version": "older"}, {"version": "older", "seed": 1}, {}, {"version": "older", "engine": "mujoco"}):
            file.write(json.dumps(line | changed) + "\n")
        file.write(
            json.dumps(line | {"version": "older", "cases": [row | {"auc": float("nan")} for row in line["cases"]], "seed": 2}) + "\n"
        )
    found = exam_scoreboard.every_version(board)
    located = next(f for f in found["figures"] if f["metric"] == "localisation, AUC")
    json.dumps(found, allow_nan=False)  # an old line that says NaN is still read
    assert located["cases"] == 0
    assert found["cases"] == 4 and found["versions"] == {exam.version(): 1, "older": 3}
    assert exam_scoreboard.every_version(board, "old")["versions"] == {"older": 3}


def test_another_edition_of_the_exam_is_not_pooled_with_this_one(folder, tmp_path, monkeypatch):
    """Other questions and marks; the lines of the first say nothing of it."""
    monkeypatch.setattr(exam, "run_apart", lambda command, place: ("", "", 1))
    monkeypatch.setattr(exam.Exam, "questions", lambda self: [QUESTION])
    board = tmp_path / "board.jsonl"
    exam.sit(exam.Exam(folder, 1, 0, "sealed"), scoreboard=board)
    line = json.loads(board.read_text())
    assert line.pop("edition") == exam_scoreboard.EDITION
    board.write_text(json.dumps(line) + "\n")
    assert exam_scoreboard.every_version(board)["cases"] == 0 and not exam_scoreboard.attempts(board, exam.version())
    assert exam_scoreboard.every_version(board, edition=1)["cases"] == 1


def test_what_a_rival_closes_is_told_against_the_diagnosis_own_before(folder, tmp_path_factory, monkeypatch):
    """A worse base of its own would leave a rival more to close. So too where the diagnosis answered on another machine."""
    monkeypatch.setattr(exam.Exam, "questions", lambda self: [QUESTION])
    guess = Rival("guess", "guesses", "nobody", lambda case: None)
    other_machine = tmp_path_factory.mktemp("elsewhere")
    elsewhere = Folder(shutil.copytree(folder.root, other_machine / "exam"))
    predicted(folder, None, before=0.01)
    for rival_in in (folder, elsewhere):
        predicted(rival_in, "guess", before=0.05)
        board = other_machine / f"{rival_in.root.name}.jsonl"
        exam.sit(exam.Exam(folder, 1, 0, "sealed"), scoreboard=board)
        exam.sit(exam.Exam(rival_in, 1, 0, "sealed"), rivals=[guess], scoreboard=board)
        (row,) = json.loads(board.read_text().splitlines()[1])["rivals"]["guess"]
        assert row["before_mm"] == pytest.approx(10) and row["after_mm"] == pytest.approx(20) and row["worse"]
    assert exam.mark(folder, 7, "guess")["before_mm"] == pytest.approx(50)  # what it would be by its own


def predicted(folder, rival, *, before):
    """An answer whose base predicts so many metres beside the truth, and which predicts 20 mm beside it."""
    x = np.zeros((3, 2, 3))
    folder.keep_answer(7, rival, None, by=exam.version(), beside={}, errors="")
    (folder.answer(7, rival) / "answer.json").write_text(json.dumps(ANSWER))
    np.savez(folder.answer(7, rival) / "pred.npz", before=x + np.array([before, 0, 0]), after=x + np.array([0.02, 0, 0]))


def test_rivals_answer_the_same_files_and_stand_beside_the_diagnosis(folder, tmp_path, monkeypatch):
    calls = []

    def run(command, place):
        assert sorted(p.name for p in place.iterdir()) == sorted(OPEN_FILES)
        calls.append(command[3:6])
        return "", "", 1

    monkeypatch.setattr(exam, "run_apart", run)
    monkeypatch.setattr(exam.Exam, "questions", lambda self: [QUESTION])
    guess = Rival("guess", "guesses", "nobody", lambda case: None)
    board = tmp_path / "board.jsonl"
    sitting = exam.Exam(folder, 1, 0, "sealed")
    for _ in range(2):  # the second time all is there
        result = exam.sit(sitting, rivals=[guess, replace(guess, name="ponder", slow=True)], scoreboard=board)
    assert calls == [["gap", "run", "train-1.npz"], ["exam", "rival", "--name"]]  # 7 is not of the third
    line = json.loads(board.read_text().splitlines()[0])
    assert [row["number"] for row in line["rivals"]["guess"]] == [7] and line["rivals"]["ponder"] == []
    assert result["rivals"]["guess"]["cases"] == 1 and result["rivals"]["ponder"]["cases"] == 0
    assert result["rivals"]["guess"]["ours"] == result["figures"]


def test_slow_rivals_answer_a_third():
    slow = Rival("ponder", "", "", lambda case: None, slow=True)
    assert [n for n in range(10) if exam.answers(slow, n)] == [0, 3, 6, 9]
    assert all(exam.answers(replace(slow, slow=False), n) for n in range(10))


def test_attempts_from_before_there_were_rivals_are_still_read(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(exam, "run_apart", lambda command, place: ("", "", 1))
    monkeypatch.setattr(exam.Exam, "questions", lambda self: [QUESTION])
    board, sitting = tmp_path / "board.jsonl", exam.Exam(folder, 1, 0, "sealed")
    exam.sit(sitting, scoreboard=board)
    old = json.loads(board.read_text())
    del old["rivals"], old["engine"]
    board.write_text(json.dumps(old) + "\n")
    result = exam.sit(sitting, rivals=[Rival("guess", "", "", lambda case: None)], scoreboard=board)
    assert result["cases"] == 1 and result["rivals"]["guess"]["cases"] == 1


def test_a_rival_runs_under_the_hook(tmp_path):
    ended = subprocess.run(
        [sys.executable, "-m", "flows.exam_candidate", "exam", "rival", "a.npz", "--name", "oracle", "--predict", "b.npz", "--out", "."],
        cwd=tmp_path,
        env={"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 2 and "there is no rival 'oracle'" in ended.stderr, ended.stderr


def test_a_longer_exam_counts_the_cases_of_a_shorter_one_once(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(exam, "run_apart", lambda command, place: ("", "", 1))
    monkeypatch.setattr(exam.Exam, "questions", lambda self: [QUESTION])
    board = tmp_path / "board.jsonl"
    exam.sit(exam.Exam(folder, 1, 0, "sealed"), scoreboard=board)
    assert exam.sit(exam.Exam(folder, 2, 0, "sealed"), scoreboard=board)["cases"] == 1
    assert exam.sit(exam.Exam(folder, 2, 1, "sealed"), scoreboard=board)["cases"] == 2  # another set


def test_code_that_changes_during_a_sealed_exam_is_refused(folder, tmp_path, monkeypatch):
    changing = iter("abcdef")
    monkeypatch.setattr(exam, "run_apart", lambda command, place: ("", "", 1))
    monkeypatch.setattr(exam.Exam, "questions", lambda self: [QUESTION])
    monkeypatch.setattr(exam, "version", lambda: next(changing))
    board = tmp_path / "board.jsonl"
    with pytest.raises(RuntimeError, match="changed during the exam"):
        exam.sit(exam.Exam(folder, 1, 0, "sealed"), scoreboard=board)
    assert not board.exists()


def test_a_task_is_done_when_its_case_is_answered_by_all_or_cannot_be_made(folder):
    task = exam.Task(exam.Exam(folder, 1, 0, "open"), QUESTION, ("chance",))
    for rival in (None, "chance"):
        assert not task.done
        folder.answer(7, rival).mkdir(parents=True)
        (folder.answer(7, rival) / "answer.json").write_text("null")
    assert task.done
    other = replace(task, question=replace(QUESTION, number=8))
    assert not other.done
    folder.case(8).mkdir(parents=True)
    folder.left_out(8).write_text("it passes through itself")
    assert other.done


@pytest.mark.slow
def test_tasks_in_processes_of_their_own_answer_as_in_turn_and_leave_out_what_is_done(folder, monkeypatch):
    """The recordings are of two vertices, which the diagnosis refuses: that is an answer, too."""
    task = exam.Task(exam.Exam(folder, 1, 0, "open"), QUESTION, ("chance",))
    said = []
    exam.at_once(2)([task], said.append)
    assert said == ["case 7: there", "case 7: chance"] and task.done
    monkeypatch.setattr(exam, "run_in_children", lambda function, arguments, **_: pytest.fail("it was begun again"))
    exam.at_once(2)([task, task], said.append)
    assert said[-1] == "case 7: chance"


def test_other_engines_stand_apart_on_the_scoreboard(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(exam, "run_apart", lambda command, place: ("", "", 1))
    monkeypatch.setattr(exam.Exam, "questions", lambda self: [QUESTION])
    board = tmp_path / "board.jsonl"
    theirs = exam.sit(exam.Exam(folder, 1, 1, "sealed", "mujoco"), scoreboard=board)
    assert theirs["engine"] == "mujoco" and theirs["cases"] == 0 and theirs["too_small"] == [7]  # without a null nothing counts
    ours = exam.sit(exam.Exam(folder, 1, 0, "sealed"), scoreboard=board)
    assert ours["cases"] == 1 and list(ours["apart"]) == ["mujoco"] and ours["apart"]["mujoco"]["cases"] == 0
    assert exam.folder_name(0, "open", "mujoco") == "open-0-mujoco" != exam.folder_name(0, "open", "own")
