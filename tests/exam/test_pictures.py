"""Cases from images: sealed before they are filmed, kept when asked again, marked apart from all others; a run that fails answers nothing."""

import json
from dataclasses import replace

import numpy as np
import pytest

from flows import exam, exam_pictures
from flows.exam import version
from flows.exam_folder import Folder
from flows.exam_pictures import FAULTS, diagnose, make, mark, questions, sit
from flows.exam_scoreboard import PICTURES
from tasks.capture.demo.recording import STANDARD
from tasks.effects.library import library
from tasks.exam.scorer.page import page

SIZE = {"magnitude_mm": 20.0, "numerics_mm": 3.0, "noise_mm": 2.0, "multiple": 5.5}


def answering(names: list[str]) -> dict:
    """An answer of `gap` that names these."""
    verdict = {"kind": "effect", "effects": names[:1], "class": [names], "probability": 0.7, "sentence": ""}
    ranking = [{"class": names, "probability": 0.7, "strength": {}}]
    ranking += [{"class": [other], "probability": 0.15, "strength": {}} for other in ("none", "outside_library")]
    return {"verdict": verdict, "ranking": ranking, "answer_set_90": [*names, "none"], "where": {}, "seconds": 100.0}


@pytest.fixture
def answered(tmp_path, monkeypatch):
    """A folder whose recordings are not filmed, and whose every case is answered with the class of `body_offset`."""
    monkeypatch.setattr(exam_pictures, "make_demo_recording", lambda *where, **asked: None)

    def answer(folder, q) -> None:
        told = {"artifacts": None, "answer": answering(["body_offset", "contact_thickness"])}
        folder.keep_answer(q.number, None, told, by=exam.version(), beside={}, errors="")
        (folder.answer(q.number) / "size.json").write_text(json.dumps(SIZE))

    monkeypatch.setattr(exam_pictures, "diagnose", answer)
    return Folder(tmp_path / "exam")


def test_faults_are_plausible_and_every_case_is_another() -> None:
    asked = questions(8, 3)
    assert [q.fault for q in asked] == 4 * list(FAULTS)
    assert asked == questions(8, 3) and asked[:3] == questions(3, 3) and asked != questions(8, 4)
    assert len({q.request.seed for q in asked}) == 8
    for q in asked:
        allowed = library()[q.fault].strengths
        assert len(q.strengths) == len(allowed)
        assert all(s.low <= θ <= s.high for θ, s in zip(q.strengths, allowed, strict=True))
        assert np.linalg.norm(q.strengths) >= allowed[0].typical, "too small to be asked for"
        assert q.as_json()["causes"][q.fault]["unit"] == {"gravity_tilt": "rad", "body_offset": "m"}[q.fault]
        assert replace(q.request, seed=STANDARD.seed, energy=STANDARD.energy) == STANDARD


def test_the_truth_is_sealed_before_anything_is_filmed(tmp_path, monkeypatch) -> None:
    folder, (q, *_), order = Folder(tmp_path), questions(2, 0), []

    def film(root, truth_root, **asked) -> None:
        order.append((folder.case(0) / "truth.sha256").exists())
        assert truth_root.name.endswith(".truth") and asked["unmodelled"] == q.unmodelled and asked["request"] == q.request

    monkeypatch.setattr(exam_pictures, "make_demo_recording", film)
    make(folder, q)
    make(folder, q)
    assert order == [True, True]  # the maker itself goes on where it was
    assert set(folder.truth(0)["causes"]) == {q.fault}
    (folder.sealed(0) / "truth.json").write_text("{}")
    with pytest.raises(ValueError, match="not what was sealed"):
        folder.truth(0)


def test_a_run_that_fails_answers_nothing(tmp_path, monkeypatch) -> None:
    """There is no recording of the actor: the stages refuse, and so nothing is answered; the case is marked as failed."""
    folder, (q, *_) = Folder(tmp_path), questions(1, 0)
    monkeypatch.setattr(exam_pictures, "make_demo_recording", lambda *where, **asked: None)
    make(folder, q)
    (tmp_path / "data").mkdir()
    diagnose(folder, q)
    told = json.loads((folder.answer(0) / "answer.json").read_text())
    assert told == {"artifacts": None, "answer": None}
    assert "case-0000" in (folder.answer(0) / "stderr.txt").read_text()
    (folder.answer(0) / "size.json").write_text(json.dumps(SIZE))
    row = mark(folder, q)
    assert row["failed"] and row["kind"] == "failed" and row["probability_of_truth"] == 0


def test_a_run_that_takes_too_long_answers_nothing(tmp_path, monkeypatch) -> None:
    folder, (q, *_) = Folder(tmp_path), questions(1, 0)
    monkeypatch.setattr(exam_pictures, "run_apart", lambda command, place: ("", "no answer within 7200 s", 5))
    diagnose(folder, q)
    assert json.loads((folder.answer(0) / "answer.json").read_text())["answer"] is None


def test_they_are_marked_and_stand_apart(answered, tmp_path) -> None:
    """Both body cases are right by the class, both tilts are missed; the scoreboard says that they are pictures."""
    board = tmp_path / "board.jsonl"
    found = sit(answered, 4, 0, "sealed", scoreboard=board)
    assert [row["right"] for row in found["rows"]] == [False, True, False, True]
    assert [row["credit"] for row in found["rows"]] == [0.0, 1.0, 0.0, 1.0]
    (line,) = map(json.loads, board.read_text().splitlines())
    assert (line["engine"], line["version"], line["count"]) == (PICTURES, version(), 4)
    figures = {f["metric"]: f["value"] for f in found["figures"]}
    assert figures["top-1, single effects from 2x the floor"] == 0.5
    assert "cases from images: 4" in page(found)
    elsewhere = Folder(tmp_path / "elsewhere")
    assert sit(elsewhere, 4, 0, "sealed", scoreboard=board) == found  # what was answered once is not done again, on whatever machine
    assert not elsewhere.root.exists() and len(board.read_text().splitlines()) == 1


def test_no_case_is_begun_after_its_hours(answered, tmp_path) -> None:
    board = tmp_path / "board.jsonl"
    assert sit(answered, 2, 0, "sealed", hours=0, scoreboard=board)["cases"] == 0 and not board.exists()
    assert sit(answered, 2, 0, "sealed", hours=1, scoreboard=board)["cases"] == 2
    sit(answered, 4, 0, "sealed", scoreboard=board)
    assert [[row["number"] for row in json.loads(line)["cases"]] for line in board.read_text().splitlines()] == [[0, 1], [2, 3]]


def test_what_is_done_is_entered_however_a_sitting_ends(answered, tmp_path, monkeypatch) -> None:
    """A case that fails keeps no other off; who interrupts loses nothing."""
    board, said, works = tmp_path / "board.jsonl", [], exam_pictures.diagnose

    def fails(number, error) -> None:
        def diagnose(folder, q) -> None:
            if q.number == number:
                raise error
            works(folder, q)

        monkeypatch.setattr(exam_pictures, "diagnose", diagnose)

    fails(0, RuntimeError("it was killed"))
    with pytest.raises(RuntimeError, match=r"left for another time: 0$"):
        sit(answered, 2, 0, "sealed", scoreboard=board, say=said.append)
    assert any(line.startswith("case-0000: ") and "it was killed" in line for line in said)
    fails(3, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        sit(answered, 4, 0, "sealed", scoreboard=board)
    assert [[row["number"] for row in json.loads(line)["cases"]] for line in board.read_text().splitlines()] == [[1], [0, 2]]


def test_an_open_exam_asks_again_what_other_code_has_answered(answered, monkeypatch) -> None:
    answers, works = [], exam_pictures.diagnose

    def counted(folder, q) -> None:
        if not folder.answered(q.number):
            answers.append(works(folder, q))

    monkeypatch.setattr(exam_pictures, "diagnose", counted)
    for of in ("a" * 64, "a" * 64, "b" * 64):
        for module in (exam, exam_pictures):
            monkeypatch.setattr(module, "version", lambda of=of: of)
        assert sit(answered, 2, 0, "open")["version"] == of
    assert len(answers) == 4


@pytest.mark.slow
def test_a_small_case_goes_from_pictures_to_a_mark(tmp_path) -> None:
    """Filmed, tracked, diagnosed and measured, at a size at which nothing can be found: twelve frames in four cameras."""
    folder, small = Folder(tmp_path), replace(STANDARD, cameras=4, frames=12, size=256, spp=4)
    q = questions(2, 0, size=small)[1]
    make(folder, q)
    diagnose(folder, q)
    told = json.loads((folder.answer(1) / "answer.json").read_text())
    assert told["answer"] is not None, (folder.answer(1) / "stderr.txt").read_text()
    row = mark(folder, q)
    size = json.loads((folder.answer(1) / "size.json").read_text())
    assert not row["failed"] and row["causes"] == ["body_offset"] and row["multiple"] == size["multiple"]
    assert 1.0 < size["magnitude_mm"] < 30.0 and 0.0 < size["numerics_mm"] < 30.0 and 0.5 < size["noise_mm"] < 60.0, size
    before = {file: file.stat().st_mtime_ns for file in (tmp_path / "artifacts").rglob("*.json")}
    make(folder, q)
    diagnose(folder, q)
    assert mark(folder, q) == row  # nothing is done twice
    assert before == {file: file.stat().st_mtime_ns for file in (tmp_path / "artifacts").rglob("*.json")}
