"""A small sealed exam from end to end: made, diagnosed behind the hook, guessed at by chance, marked, and added to a scoreboard."""

import json
from functools import partial

import numpy as np
import pytest

from flows import exam
from tasks.exam.generator import making
from tasks.exam.generator.subject import drawn_subject
from tasks.exam.rivals.library import rivals
from tasks.exam.scorer.page import page

CASES = 6
VERTICES = 120  # of a garment's coarse mesh, for the whole to end within ten minutes; an exam's has 250 to 290


@pytest.mark.slow
def test_a_small_sealed_exam(tmp_path, monkeypatch):
    monkeypatch.setattr(making, "drawn_subject", partial(drawn_subject, vertices=VERTICES))
    board, folder = tmp_path / "board.jsonl", exam.Folder(tmp_path / "exam")
    sitting, chance = exam.Exam(folder, CASES, 0, "sealed"), [rivals()["chance"]]
    result = exam.sit(sitting, rivals=chance, scoreboard=board)

    assert result["cases"] + len(result["left_out"]) == CASES
    assert {row["stratum"] for row in result["rows"]} <= {"single", "pair", "null", "outside", "inseparable"}
    for row in [*result["rows"], *result["rivals"]["chance"]["rows"]]:
        assert not row["failed"], row
        assert row["kind"] in ("effect", "none", "outside_library", "not_testable")
        assert row["kind"] == "not_testable" or np.isfinite(row["before_mm"])
    for number in folder.numbers():
        assert folder.truth(number)["question"]["number"] == number
        for rival in (None, "chance"):
            answer = json.loads((folder.answer(number, rival) / "answer.json").read_text())
            assert sum(entry["probability"] for entry in answer["ranking"]) == pytest.approx(1)
    assert "Rivals" in page(result)

    written = {file: file.stat().st_mtime_ns for file in (tmp_path / "exam").rglob("*.*")}
    again = exam.sit(sitting, rivals=chance, scoreboard=board)
    assert again == result  # nothing is made or asked twice, nor added to the scoreboard
    assert written == {file: file.stat().st_mtime_ns for file in (tmp_path / "exam").rglob("*.*")}
    assert [json.loads(line)["version"] for line in board.read_text().splitlines()] == [exam.version()]
