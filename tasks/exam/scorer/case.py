"""One answer against one truth: what counts as right, and by how much.

answer: the JSON of the diagnosis, version 1. truth: that of the generator. A diagnosis that failed or did not end answers nothing (None).
Credit of a set of names: 1/(1 + names outside the admissible class) if it holds the truth and at most MOST names, else 0. Of two causes the
mean of both credits, names that may stand for the other one set aside.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Json = Mapping[str, Any]
MOST = 4  # names in an answer that may still count as one
CLOSABLE = 1.5  # a gap is scored where it is that many floors
ABSTAINING = ("outside_library", "not_testable")


def credit(names: Iterable[str], truth: str, admissible: Iterable[str]) -> float:
    """Credit of a set of names for one true cause."""
    names = set(names)
    if truth not in names or len(names) > MOST:
        return 0.0
    return 1 / (1 + len(names - set(admissible) - {truth}))


def credits(names: Iterable[str], truth: Json) -> list[float]:
    """Credit of a set of names for each true cause."""
    allowed = {cause: {cause, *truth["admissible"][cause]} for cause in truth["causes"]}
    beside = {cause: set().union(*(own for other, own in allowed.items() if other != cause)) - allowed[cause] for cause in allowed}
    return [credit(set(names) - beside[cause], cause, allowed[cause]) for cause in allowed]


def expected(truth: Json) -> str:
    """The kind of verdict that is right: effect, none or outside_library."""
    if not truth["causes"]:
        return "none"
    return "outside_library" if truth["question"]["stratum"] == "outside" else "effect"


def score(truth: Json, answer: Json | None) -> dict[str, Any]:
    """The row of one case: everything the summary needs, and nothing that a second look would want to recompute."""
    causes, question = list(truth["causes"]), truth["question"]
    row: dict[str, Any] = {
        "number": question["number"],
        "stratum": question["stratum"],
        "twist": question["twist"],
        "withheld": question["withheld"] if question["stratum"] == "outside" else [],
        "causes": causes,
        "asked_multiple": [cause.get("asked_multiple") for cause in truth["causes"].values()],
        "multiple": truth["multiple"],
        "magnitude_mm": truth.get("magnitude_mm"),
        "expected": expected(truth),
        "failed": answer is None,
    }
    if answer is None:
        nothing = dict.fromkeys(("credit", "top1", "top3", "probability_of_truth"), 0.0)
        return row | nothing | {"kind": "failed", "named": [], "right": False, "covered": False}
    verdict = answer["verdict"]
    named = {n for group in verdict["class"] for n in group} | set(verdict["effects"]) if verdict["kind"] == "effect" else set()
    groups = [set(entry["class"]) for entry in answer["ranking"]]
    row |= {"kind": verdict["kind"], "named": sorted(named), "confidence": float(verdict["probability"]), "seconds": answer["seconds"]}
    row["set_size"] = len(answer["answer_set_90"])
    if row["expected"] == "effect":
        each = credits(named, truth)
        row["credit"], row["found"] = float(np.mean(each)), sum(e > 0 for e in each)
        row["top1"], row["top3"] = max(credits(groups[0], truth)), max(max(credits(g, truth)) for g in groups[:3])
        row["right"] = min(each) == 1.0  # a wrong name beside the right one divides its credit
        row["probability_of_truth"] = sum(e["probability"] * float(np.mean(credits(e["class"], truth))) for e in answer["ranking"])
        row["covered"] = set(causes) <= set(answer["answer_set_90"])
        row |= _strengths(truth["causes"], answer["ranking"])
    else:
        right = row["expected"]
        row["right"] = verdict["kind"] == right
        row["credit"] = float(row["right"])
        row["top1"], row["top3"] = float({right} == groups[0]), float({right} in groups[:3])
        row["probability_of_truth"] = sum(e["probability"] for e in answer["ranking"] if set(e["class"]) == {right})
        row["covered"] = right in answer["answer_set_90"]
    accelerations = answer["where"].get("vertex_accel")
    if truth["local"] and accelerations is not None:
        changed = most_changed(np.array(truth["acceleration"]))
        if changed.any():
            row["auc"] = area_under_curve(np.array(accelerations, float), changed)
    return row


def closing(
    prediction: Mapping[str, Array] | None, held_out: Mapping[str, Any], floor_m: float, before_mm: float | None = None
) -> dict[str, Any]:
    """How far a blind prediction closes the gap: before, after [T, V, 3] m against the recording that was held out, driven nodes aside.

    before_mm: the gap that is to be closed, where it is not that of `before`.

    Frames that the blind file showed do not count. `worse` only where `after` is not `before`: nothing is carried over where nothing was
    named, whatever gap is to be closed.
    """
    if prediction is None:
        return {}
    x = held_out["vertices"]
    seen = held_out["observed"] & np.isfinite(x).all(-1)
    seen[:2] = False
    seen[:, held_out["boundary"]] = False
    E = {k: float(np.mean(np.sum((prediction[k] - x)[seen] ** 2, -1))) for k in ("before", "after")}
    if before_mm is not None:
        E["before"] = (before_mm / 1e3) ** 2
    row: dict[str, Any] = {"before_mm": 1e3 * E["before"] ** 0.5, "after_mm": 1e3 * E["after"] ** 0.5}
    if not np.array_equal(prediction["after"][seen], prediction["before"][seen]):
        row["worse"] = E["after"] > 1.05 * E["before"]
    if E["before"] ** 0.5 >= CLOSABLE * floor_m:
        row["closed"] = (E["before"] - E["after"]) / (E["before"] - floor_m**2)
    return row


def most_changed(acceleration: Array) -> NDArray[np.bool_]:
    """The fifth of the vertices [V] whose acceleration changes most; fewer where the cause leaves more than four fifths as they are."""
    return (acceleration >= np.quantile(acceleration, 0.8)) & (acceleration > 0)


def area_under_curve(value: Array, positive: NDArray[np.bool_]) -> float:
    """Probability that a positive vertex has the larger value (Mann and Whitney); unseen vertices (NaN) rank lowest, ties count half."""
    value = np.where(np.isfinite(value), value, -np.inf)
    a, b = value[positive], value[~positive]
    return float(np.mean((a[:, None] > b) + 0.5 * (a[:, None] == b)))


def _strengths(causes: Json, ranking: list[Json]) -> dict[str, Any]:
    """Relative error of a single cause's strength and whether its interval holds the truth, where the units agree. Of an effect with
    several strengths the one that was planted counts, or the size of all.
    """
    if len(causes) != 1:
        return {}
    name, true = next(iter(causes.items()))
    for entry in ranking:
        found = entry.get("strength", {}).get(name)
        if found and "components" in found:
            found = found["components"].get(true.get("along"), found)
        if found and found.get("unit") == true["unit"] and found.get("value") is not None:
            return {
                "strength_error": abs(found["value"] - true["strength"]) / abs(true["strength"]),
                "strength_covered": found["low"] <= true["strength"] <= found["high"],
            }
    return {}
