"""The blind check: a sealed exam with all rivals, against the targets. This is what may be quoted.

    python -m tests.benchmarks.exam     QUICK=1: a tenth     JSON=1: JSON on stdout     RIVALS=0: the diagnosis alone     ENGINE=mujoco: its 24 cases

Cases and answers are kept below PHYSAVATAR_CACHE (default ~/.cache/physavatar), in a folder of the examined code's version: a run that was
interrupted goes on where it was. Every run is added to the scoreboard, and the figures pool all attempts of the version.
"""

import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from flows.exam import Exam, Folder, sit, version
from flows.exam_engine import prepare
from tasks.exam.rivals.library import rivals
from tasks.exam.scorer.beside import columns

QUICK = bool(os.environ.get("QUICK"))
ENGINE = os.environ.get("ENGINE", "own")
FULL = 160 if ENGINE == "own" else 24
CASES, SEED = (
    (FULL // 10, 1) if QUICK else (FULL, 0)
)  # another seed: the short exam shares no case with the long one, and is pooled with it
NOMINAL = 0.9
Row = dict[str, Any]
# metric, at least or at most, what resolves the claim, what is aimed at
TARGETS = (
    ("probability of the true class, single effects", ">=", 0.75, 0.88),
    ("top-1, single effects from 2x the floor", ">=", 0.80, 0.92),
    ("top-3, single effects from 2x the floor", ">=", 0.95, 0.99),
    ("false attribution on nulls", "<=", 1 / 32, 0.0),
    ("outside the library: abstains (recall)", ">=", 0.60, 0.80),
    ("outside the library: confident wrong name", "<=", 0.10, 0.05),
    ("mean size of 90 % answer sets", "<=", 3.0, 1.8),
    ("localisation, AUC", ">=", 0.85, 0.95),
    ("closed fraction on held-out motion, median", ">=", 0.70, 0.90),
    ("negative transfer, of predictions that a name changed", "<=", 0.05, 0.02),
    ("pairs: both named", ">=", 0.50, 0.75),
    ("pairs: at least one named", ">=", 0.90, 0.98),
)
COVERAGE = "90 % answer sets that hold the truth"


def cache() -> Path:
    """The folder of this version's exam."""
    return (
        Path(os.environ.get("PHYSAVATAR_CACHE", "~/.cache/physavatar")).expanduser() / "bench-exam" / f"{ENGINE}-{CASES}-{version()[:12]}"
    )


def table(result: Row) -> Iterator[Row]:
    """metric, value with its 95 % interval, cases, target, whether it holds, and what rivals reach on how many cases."""
    figures = {f["metric"]: f for f in result["figures"]}
    beside = {heading: values for heading, values in columns(result).items() if heading != f"diagnosis ({result['cases']})"}

    def row(metric: str, target: str, holds: bool) -> Row:
        return figures[metric] | {"target": target, "holds": holds, "beside": {name: values[metric] for name, values in beside.items()}}

    for metric, sense, floor, aim in TARGETS:
        value = figures[metric]["value"]
        holds = value is not None and (value >= floor if sense == ">=" else value <= floor)
        yield row(metric, f"{sense} {floor:.2g} (aim {aim:.2g})", holds)
    covered = figures[COVERAGE]
    yield row(COVERAGE, f"{NOMINAL} inside its interval", covered["low"] <= NOMINAL <= covered["high"] and covered["cases"] > 0)


def main() -> None:
    """Sit the exam and print metric | value | target | holds | rivals."""
    if ENGINE != "own":
        prepare()
    beside = [] if os.environ.get("RIVALS") == "0" else list(rivals().values())
    result = sit(Exam(Folder(cache()), CASES, SEED, "sealed", ENGINE), rivals=beside, say=lambda line: sys.stderr.write(line + "\n"))
    rows = list(table(result))
    if os.environ.get("JSON"):
        whole = {"version": result["version"], "cases": result["cases"], "left_out": result["left_out"], "rows": rows}
        sys.stdout.write(json.dumps(whole, indent=1) + "\n")
        return
    for row in rows:
        others = "; ".join(f"{name} {_number(value)}" for name, value in row["beside"].items())
        interval = f"{_number(row['value'])} [{_number(row['low'])}, {_number(row['high'])}] of {row['cases']}"
        sys.stdout.write(f"{row['metric']:50s} | {interval:30s} | {row['target']:22s} | {'yes' if row['holds'] else 'NO':3s} | {others}\n")


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


if __name__ == "__main__":
    main()
