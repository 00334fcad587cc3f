"""Figures over many cases, each with its 95 % interval: Wilson's for shares, bootstrap over cases for the rest."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from tasks.exam.scorer.case import ABSTAINING
from tasks.exam.scorer.intervals import bootstrap, wilson

Row = dict[str, Any]
VISIBLE = 2.0  # multiple of the floor from which a name is asked for
CONFIDENT = 0.8
BINS = 10


def summary(rows: Sequence[Row]) -> list[Row]:
    """metric, value, low, high, cases: every figure of an exam."""
    single = [r for r in rows if r["stratum"] == "single" and r["multiple"] >= VISIBLE]
    pairs = [r for r in rows if r["stratum"] == "pair" and r["multiple"] >= VISIBLE]
    null = [r for r in rows if r["expected"] == "none"]
    outside = [r for r in rows if r["expected"] == "outside_library"]
    inseparable = [r for r in rows if r["stratum"] == "inseparable" and r["causes"]]
    abstained = [r for r in rows if r["kind"] in ABSTAINING]
    asked = [r for r in rows if r["expected"] != "effect" or r["multiple"] >= VISIBLE]
    out = [
        _share("top-1, single effects from 2x the floor", single, lambda r: r["top1"]),
        _share("top-3, single effects from 2x the floor", single, lambda r: r["top3"]),
        _share("verdict right, single effects from 2x the floor", single, lambda r: r["credit"]),
        _mean("probability of the true class, single effects", [r["probability_of_truth"] for r in single]),
        _share("false attribution on nulls", null, lambda r: r["kind"] == "effect"),
        _share("pairs: both named", pairs, lambda r: r.get("found") == 2),
        _share("pairs: at least one named", pairs, lambda r: r.get("found", 0) >= 1),
        _share("inseparable by design: class right", inseparable, lambda r: r["credit"]),
        _share("outside the library: abstains (recall)", outside, lambda r: r["kind"] in ABSTAINING),
        _share("abstentions that are outside the library (precision)", abstained, lambda r: r["expected"] == "outside_library"),
        _share("outside the library: confident wrong name", outside, lambda r: r["kind"] == "effect" and r["confidence"] > CONFIDENT),
        _share("90 % answer sets that hold the truth", [r for r in asked if "covered" in r], lambda r: r["covered"]),
        _mean("mean size of 90 % answer sets", [r["set_size"] for r in asked if "set_size" in r]),
        calibration_error([r for r in asked if "confidence" in r]),
        _mean("localisation, AUC", [r["auc"] for r in rows if r["expected"] == "effect" and r.get("auc") is not None]),
        _mean("closed fraction on held-out motion, median", [r["closed"] for r in single if "closed" in r], np.median),
        _share("negative transfer, of predictions that a name changed", [r for r in rows if "worse" in r], lambda r: r["worse"]),
        _mean("error of the strength, median", [r["strength_error"] for r in single if "strength_error" in r], np.median),
        _share("intervals of the strength that hold it", [r for r in single if "strength_covered" in r], lambda r: r["strength_covered"]),
        _mean("seconds per diagnosis, median", [r["seconds"] for r in rows if "seconds" in r], np.median),
        _share("diagnoses that failed", rows, lambda r: r["failed"]),
    ]
    for low in sorted({_rung(r["multiple"]) for r in rows if r["stratum"] == "single"}):
        near = [r for r in rows if r["stratum"] == "single" and _rung(r["multiple"]) == low]
        out.append(_share(f"top-1, single effects near {low:g}x the floor", near, lambda r: r["top1"]))
    return out


def calibration_error(rows: Sequence[Row]) -> Row:
    """Expected calibration error: mean over cases of |share right − mean confidence| of their bin of confidence."""
    p, right = np.array([r["confidence"] for r in rows]), np.array([float(r["right"]) for r in rows])
    pairs = np.stack([p, right], 1) if len(rows) else np.zeros((0, 2))
    low, high = _resampled(pairs)
    return {"metric": "calibration error", "value": _ece(pairs), "low": low, "high": high, "cases": len(rows)}


def confusion(rows: Iterable[Row]) -> tuple[list[str], list[str], np.ndarray]:
    """Truths, answers, and how often which truth [row] got which answer [column]; a pair counts as its own truth."""
    pairs = [(_truth_name(r), _answer_name(r)) for r in rows]
    truths, answers = sorted({p[0] for p in pairs}), sorted({p[1] for p in pairs})
    table = np.zeros((len(truths), len(answers)), int)
    for truth, answer in pairs:
        table[truths.index(truth), answers.index(answer)] += 1
    return truths, answers, table


def _truth_name(r: Row) -> str:
    return r["expected"] if r["expected"] == "none" else ("withheld: " if r["withheld"] else "") + " + ".join(r["causes"])


def _answer_name(r: Row) -> str:
    return " | ".join(r["named"]) if r["kind"] == "effect" else r["kind"]


def _rung(multiple: float) -> float:
    """The magnitude of 1, 2, 4, 8 that is nearest in ratio."""
    return float(2 ** np.clip(np.rint(np.log2(max(multiple, 1e-3))), 0, 3))


def _share(metric: str, rows: Sequence[Row], of: Callable[[Row], Any]) -> Row:
    total = float(sum(float(of(r)) for r in rows))
    low, high = wilson(total, len(rows))
    return {"metric": metric, "value": total / len(rows) if rows else None, "low": low, "high": high, "cases": len(rows)}


def _mean(metric: str, values: Sequence[float], statistic=np.mean) -> Row:
    low, high = bootstrap(np.array(values), statistic)
    value = float(statistic(values)) if len(values) else None
    return {
        "metric": metric,
        "value": value,
        "low": low if len(values) else None,
        "high": high if len(values) else None,
        "cases": len(values),
    }


def _ece(pairs: np.ndarray) -> float | None:
    if not len(pairs):
        return None
    bin_of = np.minimum((pairs[:, 0] * BINS).astype(int), BINS - 1)
    gaps = [abs(pairs[bin_of == b].mean(0) @ [1, -1]) * (bin_of == b).sum() for b in np.unique(bin_of)]
    return float(np.sum(gaps) / len(pairs))


def _resampled(pairs: np.ndarray) -> tuple[float | None, float | None]:
    if not len(pairs):
        return None, None
    rng = np.random.default_rng(0)
    draws = [_ece(pairs[rng.integers(len(pairs), size=len(pairs))]) for _ in range(500)]
    low, high = np.quantile(draws, [0.025, 0.975])
    return float(low), float(high)
