"""A rival's reply as JSON, version 1: the format in which the diagnosis answers."""

from typing import Any

import numpy as np

from tasks.effects.model import Model
from tasks.exam.rivals.rival import NONE, OUTSIDE, Array, Names, Reply, Rival
from tasks.gap.answer import VERSION, strength

SHARED = 0.9  # probability that an answer set must hold


def answer(rival: Rival, reply: Reply, *, seconds: float | None) -> dict[str, Any]:
    """The whole answer; None where a rival says nothing."""
    probability = probabilities(reply)
    verdict, believed = next(iter(probability.items()))
    kind = verdict[0] if verdict in (NONE, OUTSIDE) else "effect"
    named = list(verdict) if kind == "effect" else []
    before_mm, after_mm = reply.residual_mm or (None, None)
    return {
        "version": VERSION,
        "verdict": {
            "kind": kind,
            "effects": named,
            "class": [[name] for name in named],
            "probability": believed,
            "sentence": f"{rival.does}: {' and '.join(verdict)} (probability {believed:.0%}).",
        },
        "ranking": [{"class": list(names), "probability": p, "strength": _strengths(reply, names)} for names, p in probability.items()],
        "answer_set_90": answer_set(probability),
        "gap": {
            "before_mm": before_mm,
            "after_mm": after_mm,
            "floor_mm": None,
            "closed_fraction": None,
            "low": None,
            "high": None,
            "held_out": False,
        },
        "where": {"zones": [], "vertex_mm": None, "vertex_accel": _field(reply.vertex_accel), "frame_mm": None},
        "parameters": _ratios(reply.before),
        "record_next": None,
        "seconds": seconds,
    }


def probabilities(reply: Reply) -> dict[Names, float]:
    """names -> probability, likeliest first; none and outside_library are always there. They sum to 1."""
    log_weight = dict(reply.log_weight)
    for names in (NONE, OUTSIDE):
        log_weight.setdefault(names, -np.inf)
    weight = np.exp(np.array(list(log_weight.values())) - max(log_weight.values()))
    shares = dict(zip(log_weight, (weight / weight.sum()).tolist(), strict=True))
    return dict(sorted(shares.items(), key=lambda pair: -pair[1]))


def answer_set(probability: dict[Names, float]) -> list[str]:
    """The names of the likeliest sets that together hold `SHARED`."""
    found, total = [], 0.0
    for names, p in probability.items():
        found += [n for n in names if n not in found]
        total += p
        if total >= SHARED:
            break
    return found


def _strengths(reply: Reply, names: Names) -> dict[str, dict[str, Any]]:
    """effect -> strength with its 90 % interval, for what the rival fitted and can bound; of a vector its length."""
    found = {}
    for effect in reply.after.effects:
        if effect.name in names and effect.name in reply.deviation:
            found[effect.name] = strength(effect, reply.after.strength(effect), reply.deviation[effect.name])
    return found


def _ratios(model: Model) -> dict[str, dict[str, Any]]:
    fabric = model.subject.fabric
    ratios = {"kappa_s_over_rho": fabric.membrane / fabric.density, "kappa_b_over_rho": fabric.bending / fabric.density}
    return {name: {"value": ratio, "low": None, "high": None, "unit": "m3/kg"} for name, ratio in ratios.items()}


def _field(values: Array | None) -> list[float | None] | None:
    return None if values is None else [float(x) if np.isfinite(x) else None for x in values]
