"""A change of a stage's science without a new version of the stage is refused: old artifacts would pass for new ones.

`tasks/stages.lock` holds, per stage, its version and the hash of the syntax trees of its door and of everything in tasks/ that the door
imports, directly or not; docstrings and comments do not count. After raising a stage's version (or before the first release):

    python -m tests.test_science_lock
"""

import ast
import hashlib
import json
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
LOCK = ROOT / "tasks/stages.lock"
MACHINERY = {
    f"tasks.{name}" for name in ("stage", "child_process", "content_digest", "shared_map", "side_by_side", "read_ahead", "plain_data")
}  # decides no number


@cache
def imported(module: str) -> frozenset[str]:
    """Modules of tasks/ that a module imports, also inside functions."""
    found = set()
    for node in ast.walk(ast.parse(path_of(module).read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "tasks":
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names if alias.name.split(".")[0] == "tasks"}
    return frozenset(m for m in found if path_of(m))


def path_of(module: str) -> Path | None:
    at = ROOT / Path(*module.split("."))
    return next((p for p in (at.with_suffix(".py"), at / "__init__.py") if p.exists()), None)


def science_of(door: str) -> list[str]:
    seen, waiting = set(), [door]
    while waiting:
        module = waiting.pop()
        if module not in seen:
            seen.add(module)
            waiting += imported(module)
    return sorted(seen - MACHINERY)


def digest(door: str) -> str:
    """SHA-256 of the syntax trees without docstrings."""
    whole = hashlib.sha256()
    for module in science_of(door):
        tree = ast.parse(path_of(module).read_text())
        for node in ast.walk(tree):
            body = getattr(node, "body", None)
            first = body[0] if isinstance(body, list) and body else None
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                body.pop(0)
        whole.update(f"{module}\0{ast.dump(tree)}\n".encode())
    return whole.hexdigest()


def current() -> dict[str, dict]:
    from flows.pipeline import STAGES

    return {name: {"version": stage.version, "science": digest(stage.function.__module__)} for name, stage in STAGES.items()}


def test_science_changes_only_with_its_version():
    locked, now = json.loads(LOCK.read_text()), current()
    changed = [name for name in now if name in locked and now[name]["version"] == locked[name]["version"] and now[name] != locked[name]]
    assert not changed, (
        f"the science of {', '.join(changed)} changed: raise the stage's version, then run python -m tests.test_science_lock"
    )
    assert now == locked, "run python -m tests.test_science_lock"


def test_a_change_of_code_is_seen_and_a_comment_is_not(monkeypatch):
    before = digest("tasks.gap.stage")
    real = Path.read_text
    monkeypatch.setattr(Path, "read_text", lambda self, *a, **k: "# a remark\n" + real(self, *a, **k))
    assert digest("tasks.gap.stage") == before
    monkeypatch.setattr(Path, "read_text", lambda self, *a, **k: real(self, *a, **k) + "\nx = 1\n")
    assert digest("tasks.gap.stage") != before


if __name__ == "__main__":
    LOCK.write_text(json.dumps(current(), indent=1) + "\n")
