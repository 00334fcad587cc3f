"""The diagnosis as JSON, version 1: a public format that other programs read."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.effects.effect import Effect
from tasks.gap.diagnosis import Diagnosis
from tasks.gap.held_out import Shrinkage
from tasks.gap.hypotheses import Fitted
from tasks.gap.next_recording import record_next
from tasks.gap.residual import rms_mm
from tasks.gap.verdict import Verdict

VERSION = 1


def answer(found: Diagnosis, *, seconds: float | None) -> dict[str, Any]:
    """The whole answer; None where something is unseen or does not apply."""
    v, gap = found.verdict, found.shrinkage
    return {
        "version": VERSION,
        "verdict": {
            "kind": v.kind,
            "effects": [e.name for e in v.named.effects] if v.named else [],
            "class": [list(c) for c in v.classes],
            "probability": _number(v.probability),
            "sentence": sentence(found),
        },
        "ranking": [
            {"class": list(c.names), "probability": _number(c.probability), "strength": strengths(c.fitted) if c.fitted else {}}
            for c in v.ranking
        ],
        "answer_set_90": v.answer_set,
        "gap": {
            "before_mm": _number(gap.before_mm),
            "after_mm": _number(gap.after_mm),
            "floor_mm": _number(gap.floor_mm),
            "closed_fraction": _number(gap.closed_fraction),
            "low": _number(gap.low),
            "high": _number(gap.high),
            "held_out": gap.held_out,
        },
        "where": _where(found),
        "parameters": found.parameters,
        "record_next": record_next(v, found.designs),
        "seconds": seconds,
    }


def strengths(fitted: Fitted) -> dict[str, dict[str, Any]]:
    """effect -> strength with its 90 % interval, Student's; the length of the vector where it has several components."""
    found, half, at = {}, fitted.quantile(0.95) * np.sqrt(np.maximum(np.diag(fitted.covariance), 0)), 0
    for effect in fitted.effects:
        K = len(effect.strengths)
        found[effect.name] = strength(effect, fitted.θ(effect), half[at : at + K])
        at += K
    return found


def strength(effect: Effect, θ: NDArray, half: NDArray) -> dict[str, Any]:
    """value, unit and interval of strengths θ [K] ± half [K]; of several the length of the vector, and `components`, symbol -> each."""
    each = [_interval(float(t), float(h), symbol.unit) for t, h, symbol in zip(θ, half, effect.strengths, strict=True)]
    if len(each) == 1:
        return each[0]
    length = float(np.linalg.norm(θ))
    whole = _interval(length, float(np.sqrt(θ**2 @ half**2) / max(length, 1e-30)), effect.strengths[0].unit)
    return whole | {"components": dict(zip((s.symbol for s in effect.strengths), each, strict=True))}


def _interval(value: float, half: float, unit: str) -> dict[str, Any]:
    return {"value": value, "unit": unit, "low": value - half, "high": value + half}


def sentence(found: Diagnosis) -> str:
    """The verdict in one sentence."""
    v, gap = found.verdict, found.shrinkage
    if v.kind == "not_testable":
        return f"Not testable: {v.reason}."
    start = f"The fitted cloth differs from the recording by {gap.before_mm:.1f} mm (floor {gap.floor_mm:.1f} mm)"
    if v.reason and v.named is None:
        instead = v.kind.replace("_", " the ")
        return f"{start}; {v.reason}, so nothing is named ({instead}: probability {v.probability:.0%}{_likelier(v)})."
    if v.kind == "none":
        found = "is needed to explain that" if gap.closed_fraction is None else "was found to explain that"  # None: at the floor
        return f"{start}; no effect of the library {found} (probability {v.probability:.0%})."
    if v.kind == "outside_library":
        return f"{start}; no effect of the library explains it (probability {v.probability:.0%})."
    names = ", and ".join(" or ".join(c) for c in v.classes)
    causes = f"the cause is {names}" if len(v.classes) == 1 else f"the causes are {names}"
    start += f"; {v.reason}, so of what is left" if v.reason else ";"
    return f"{start} {causes} (probability {v.probability:.0%}){_closing(gap)}."


def _likelier(v: Verdict) -> str:
    first = v.ranking[0]
    return "" if first.fitted is None else f"; {' or '.join(first.names)}: {first.probability:.0%}"


def _closing(gap: Shrinkage) -> str:
    if gap.closed_fraction is None:
        return ", though on motion kept out of the fit there is nothing to close" if gap.held_out else ""
    where = ""
    if gap.held_out:
        where = "on motion kept out of the fit, replayed in one run, " if gap.replayed else "on motion kept out of the fit "
    share = f"{gap.closed_fraction:.0%} of what can be closed"
    if gap.low is not None:
        share += f", 90 % interval {gap.low:.0%} to {gap.high:.0%}"
    return f"; with it the gap {where}falls to {gap.after_mm:.1f} mm ({share})"


def _where(found: Diagnosis) -> dict[str, Any]:
    zone = found.zone
    rows = [
        {"zone": str(z), "before_mm": _number(rms_mm(found.before[:, zone == z])), "after_mm": _number(rms_mm(found.after[:, zone == z]))}
        for z in dict.fromkeys(zone.tolist())
        if z != "pinned"
    ]
    return {
        "zones": rows,
        "vertex_mm": [_number(rms_mm(found.before[:, i])) for i in range(found.before.shape[1])],
        "vertex_accel": [_number(a) for a in found.vertex_accel],
        "frame_mm": [_number(a) for a in found.frame_mm],
    }


def _number(x: float | None) -> float | None:
    return None if x is None or not np.isfinite(x) else float(x)
