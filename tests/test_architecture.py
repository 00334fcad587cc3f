"""The layout holds: import contracts, style, types at the borders, and names that say something."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
VAGUE = {"utils", "util", "common", "helpers", "helper", "core", "manager", "misc", "base"}


LINTERS = (
    "lint-imports --no-cache",
    "ruff check --no-cache .",
    "ruff format --no-cache --check .",
    f"basedpyright --pythonpath {sys.executable}",
)


@pytest.mark.parametrize("linter", LINTERS, ids=[line.split(" -")[0] for line in LINTERS])
def test_a_linter_has_nothing_to_say(linter):
    program, *arguments = linter.split()
    ended = subprocess.run([Path(sys.executable).with_name(program), *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr


def test_the_contract_of_the_effects_names_all_of_them():
    contract = (ROOT / ".importlinter").read_text().split("[importlinter:contract:effects]")[1].split("[importlinter")[0]
    effects = {p.stem for p in (ROOT / "tasks/effects").glob("*.py") if "\nEFFECT = " in p.read_text()}
    assert {line.split(".")[-1] for line in contract.splitlines() if line.startswith("    tasks.effects.")} == effects


def test_every_file_is_named_for_its_idea():
    named = [p for top in ("flows", "tasks", "storage_schemas") for p in (ROOT / top).rglob("*") if "__pycache__" not in p.parts]
    assert not [str(p) for p in named if p.stem in VAGUE]


def test_every_folder_of_code_says_what_it_is():
    folders = {p.parent for top in ("flows", "tasks", "storage_schemas") for p in (ROOT / top).glob("*/*.py")} | {
        ROOT / "storage_schemas",
        ROOT / "flows",
    }
    assert not sorted(str(f.relative_to(ROOT)) for f in folders if not (f / "README.md").exists())
