"""`physavatar exam` as a user meets it: numbers that it refuses, and where its page goes."""

import json

import pytest

from flows import cli, exam, exam_scoreboard


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        cli.main(["exam", *arguments])
    return ended.value.code


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--at-once", "0"], "--at-once"),
        (["--at-once", "-2", "--service"], "--at-once"),
        (["--cases", "0", "--split", "sealed"], "--cases"),
        (["--hours", "-1"], "--hours"),
        (["pictures", "--cases", "0"], "--cases"),
        (["generate", "--cases", "0", "--out", "exam"], "--cases"),
        (["generate", "--cases", "2", "--first", "-1", "--out", "exam"], "--first"),
    ],
)
def test_an_exam_of_nothing_or_by_nobody_is_refused(tmp_path, monkeypatch, capsys, arguments, named):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(exam, "sit", lambda *_, **__: pytest.fail("it was sat"))
    assert run(*arguments) == 2
    said = capsys.readouterr().err
    assert named in said and "Must be >= " in said
    assert not list(tmp_path.iterdir())


def test_a_folder_holds_the_cases_of_one_seed(tmp_path, monkeypatch, capsys):
    """What is there is not made again: it would be told as a case of the other seed."""
    made = []
    monkeypatch.setattr(exam, "generate", lambda folder, wanted: made.extend(wanted) or iter([]))
    out = str(tmp_path / "exam")

    def generate(seed):
        return run("generate", "--cases", "1", "--seed", seed, "--out", out), " ".join(capsys.readouterr().err.split())

    assert [generate("1")[0], generate("1")[0]] == [0, 0] and len(made) == 2
    ended, said = generate("2")
    assert ended == 2 and len(made) == 2
    assert "--seed 2" in said and "holds the cases of seed 1. Give another folder, or ask for --seed 1" in said
    (tmp_path / "exam/seed").unlink()
    (tmp_path / "exam/cases").mkdir()
    ended, said = generate("1")  # as a folder from before seeds were noted
    assert ended == 2 and "write that seed into" in said


def test_workers_have_no_hours(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(exam, "sit", lambda *_, **__: pytest.fail("it was sat"))
    assert run("--hours", "2", "--service") == 2
    assert "cancel the run exam" in " ".join(capsys.readouterr().err.split())


def test_the_page_is_written_where_nothing_was_left_to_do(tmp_path, monkeypatch, capsys):
    """As of an exam whose cases are all on the scoreboard, on a machine that has made none of them."""
    attempt = {"version": "0" * 64, "engine": exam_scoreboard.OWN, "left_out": [], "cases": [], "rivals": {}}
    told = exam_scoreboard.result("open", attempt, tmp_path / "board.jsonl")
    monkeypatch.setattr(exam, "sit", lambda *_, **__: told)
    run("--out", str(tmp_path / "exam"), "--json")
    assert json.loads(capsys.readouterr().out) == json.loads((tmp_path / "exam/open-0/exam.json").read_text()) == told
    assert (tmp_path / "exam/open-0/exam.html").exists()
