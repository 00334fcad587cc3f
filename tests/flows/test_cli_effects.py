"""`physavatar effects`: the library as a table, files of the user's own beside it, and the table in the README."""

import json
from pathlib import Path

import pytest

from flows import cli
from tests.effects.test_every_effect import NAMES

README = Path(__file__).parents[2] / "tasks/effects/README.md"
OWN = """
from tasks.effects.effect import Effect, Strength


class Magnet(Effect):
    name = "contact_magnet"
    kind = "potential"
    strengths = (Strength("B", "T", 0.1, 0.0, 1.0),)


EFFECT = Magnet()
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PHYSAVATAR_CONFIG", raising=False)
    (tmp_path / "mine").mkdir()
    return tmp_path / "mine"


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        cli.main(list(arguments))
    return ended.value.code


def test_every_effect_is_listed(folder, capsys):
    assert run("effects", "--json") == 0
    listed = {e["name"]: e for e in json.loads(capsys.readouterr().out)}
    assert set(listed) == NAMES
    drag = listed["air_normal_drag"]["strengths"][0]
    assert (drag["unit"], drag["zero"], drag["column"]) == ("m2/kg", 0.0, "air_normal_drag")
    assert len(listed["gravity_tilt"]["strengths"]) == 2


def test_a_file_dropped_into_the_folder_shows_up(folder, monkeypatch, capsys):
    (folder / "magnet.py").write_text(OWN)
    monkeypatch.setenv("PHYSAVATAR_EFFECTS_FOLDER", str(folder))
    assert run("effects") == 0
    assert "contact_magnet" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("import nothing_of_that_name", "magnet.py: it cannot be imported: ModuleNotFoundError"),
        ("class Magnet(:", "magnet.py: it cannot be imported: SyntaxError"),
        ("EFFECT = 3", "magnet.py: it has no EFFECT that is one"),
        (OWN.replace('name = "contact_magnet"', "pass"), "magnet.py: its EFFECT has no name"),
        (OWN.replace("contact_magnet", "air_wind"), "the name air_wind is taken by tasks.effects.air_wind"),
    ],
)
def test_a_broken_file_ends_with_2_and_its_name(folder, monkeypatch, capsys, text, said):
    (folder / "magnet.py").write_text(text)
    monkeypatch.setenv("PHYSAVATAR_EFFECTS_FOLDER", str(folder))
    assert run("effects") == 2
    captured = capsys.readouterr()
    assert said in captured.err.replace("\n", " ") and captured.out == ""


def test_a_folder_that_is_not_there_ends_with_2(folder, monkeypatch, capsys):
    monkeypatch.setenv("PHYSAVATAR_EFFECTS_FOLDER", str(folder / "gone"))
    assert run("effects") == 2
    assert "correct effects_folder" in capsys.readouterr().err.replace("\n", " ")


def test_the_readme_holds_the_table_that_the_command_prints(folder, capsys):
    assert run("effects", "--markdown") == 0
    _, after = README.read_text().split("<!-- physavatar effects --markdown -->\n")
    assert after.split("<!-- end -->")[0] == capsys.readouterr().out
