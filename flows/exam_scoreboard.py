"""What sealed attempts add up to: one line of JSON each, never rewritten, and figures that pool all attempts of a version and an engine."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tasks.exam.scorer.engine import counted
from tasks.exam.scorer.summary import summary

SCOREBOARD = Path(__file__).parents[1] / "docs" / "exam-scoreboard.jsonl"
EDITION = 2  # of questions and marks: figures of different ones are not pooled; attempts that say nothing are of the first
OWN = "own"  # the generator's own engine; attempts from before there was another say nothing
PICTURES = "pictures"  # cases that start from images (`exam_pictures.py`)
Row = dict[str, Any]
Case = tuple[str, int, int]  # version, seed, number


def attempts(scoreboard: Path, of: str, engine: str = OWN) -> list[Row]:
    """All attempts of a version with cases of this engine, of this edition."""
    return [attempt for attempt in _of_version(scoreboard, of) if attempt.get("engine", OWN) == engine]


def pooled(attempts: Sequence[Row], rival: str | None = None) -> dict[Case, Row]:
    """Rows of all attempts, each case of a version's seed once, as it was answered first: an exam that was resumed counts once."""
    first: dict[Case, Row] = {}  # a longer exam begins with the cases of a shorter one
    for attempt in attempts:
        for row in attempt["cases"] if rival is None else attempt.get("rivals", {}).get(rival, []):
            first.setdefault((attempt["version"], attempt["seed"], row["number"]), row)
    return first


def entries(scoreboard: Path, of: str, seed: int, engine: str, rival: str | None = None) -> list[Row]:
    """Rows of the cases of a version's seed that the diagnosis, or a rival, has answered in earlier attempts."""
    return [row for (_, own, _), row in pooled(attempts(scoreboard, of, engine), rival).items() if own == seed]


def sat(scoreboard: Path, of: str, seed: int, engine: str, rival: str | None = None) -> set[int]:
    """Numbers of these cases, and of those that could not be made."""
    left_out = {n for attempt in attempts(scoreboard, of, engine) if attempt["seed"] == seed for n in attempt["left_out"]}
    return {row["number"] for row in entries(scoreboard, of, seed, engine, rival)} | left_out


def entered(split: str, attempt: Row, scoreboard: Path) -> Row:
    """The figures of an attempt (version, seed, count, engine, left_out, cases, rivals), dated; a sealed one is added to the scoreboard first."""
    attempt = {"date": datetime.now(UTC).isoformat(timespec="seconds"), "edition": EDITION, **attempt}
    if split == "sealed":
        scoreboard.parent.mkdir(parents=True, exist_ok=True)
        with scoreboard.open("a") as board:
            board.write(json.dumps(attempt) + "\n")
    return result(split, attempt, scoreboard)


def result(split: str, attempt: Row, scoreboard: Path) -> Row:
    """Figures of this attempt's engine: of an open exam those of the attempt, of a sealed one those of its version. Other engines stand apart."""
    of, engine = attempt["version"], attempt["engine"]
    if split == "open":
        return {"split": split, "version": of, "left_out": attempt["left_out"], "apart": {}} | figures(engine, [attempt])
    others = sorted({a.get("engine", OWN) for a in _of_version(scoreboard, of)} - {engine})
    apart = {other: figures(other, attempts(scoreboard, of, other)) for other in others}
    pool = attempts(scoreboard, of, engine)
    left_out = sorted({number for each in pool if each["seed"] == attempt["seed"] for number in each["left_out"]})
    return {"split": split, "version": of, "left_out": left_out, "apart": apart} | figures(engine, pool)


def every_version(scoreboard: Path = SCOREBOARD, beginning: str = "", edition: int = EDITION) -> Row:
    """Figures of all sealed cases of an edition that any version has sat, or those whose hash has this beginning, and how many each did,
    the first version first.

    A case was new to the version that sat it, for its seed holds the code. Who made a version knew how those before it had fared.
    """
    own = [a for a in _all(scoreboard, edition) if a.get("engine", OWN) == OWN and a["version"].startswith(beginning)]
    return figures(OWN, own) | {"versions": dict(Counter(version for version, _, _ in pooled(own)))}


def figures(engine: str, attempts: Sequence[Row]) -> Row:
    """Figures of the diagnosis; of each rival, its own and the diagnosis' on the cases that it answered."""
    pool = pooled(attempts)
    ours, residual_mm = (pool, None) if engine in (OWN, PICTURES) else counted(pool)
    rivals = {}
    for name in dict.fromkeys(name for attempt in attempts for name in attempt.get("rivals", {})):
        theirs = {case: row for case, row in pooled(attempts, name).items() if case in ours}
        same = summary([ours[case] for case in theirs])
        rivals[name] = {"cases": len(theirs), "figures": summary(list(theirs.values())), "ours": same, "rows": _with_seeds(theirs)}
    rows = list(ours.values())
    return {
        "engine": engine,
        "cases": len(rows),
        "null_residual_mm": residual_mm,
        "too_small": [row["number"] for case, row in pool.items() if case not in ours],
        "figures": summary(rows),
        "rivals": rivals,
        "rows": _with_seeds(ours),
    }


def _with_seeds(rows: Mapping[Case, Row]) -> list[Row]:
    return [row | {"seed": seed} for (_, seed, _), row in rows.items()]


def _of_version(scoreboard: Path, of: str) -> list[Row]:
    return [attempt for attempt in _all(scoreboard) if attempt["version"] == of]


def _all(scoreboard: Path, edition: int = EDITION) -> list[Row]:
    lines = scoreboard.read_text().splitlines() if scoreboard.exists() else []
    # the first version wrote NaN where there was nothing to locate
    attempts = [json.loads(line, parse_constant=lambda nan: None) for line in lines]
    return [attempt for attempt in attempts if attempt.get("edition", 1) == edition]
