"""The recorded sleeve: which effect does its fitted base model lack, and how far does the gap shrink with it?

    python -m tests.real.sleeve_gap          JSON=1: JSON on stdout

The diagnosis of `tasks/gap` needs a tracked surface; here 14 places are known, two at a time. So whole swings stand for its windows: about
the base fitted on repeats 1–3 and 11 places (`sleeve_fit.py`), every suspect is simulated at its typical strength; what is left of its
signature once all base parameters took their share foretells a gain, and the leaders are fitted together with all base parameters. What a
fold that falls otherwise does to the misfit is seen from the base simulated again with parameters a hundredth of their deviation off: what
gains less is not told from chance. Nothing of that sees repeats 4 and 5, or places 5, 9 and 13.

    gain = (ũᵀr̃)²/ũᵀũ,    ũ = (1 − PPᵀ) ∂r/∂θ,  P an orthonormal basis of the base's columns
    closed = (before² − after²)/(before² − floor²),    floor: the mean trajectory of repeats 1–3
"""

import json
import os
import sys
import time
from collections.abc import Sequence

import numpy as np

from tasks.child_process import Pool
from tasks.effects.library import library, suspects
from tests.real.sleeve_fit import LEFT_OUT, STEP, Array, Places, Values, fitted, held_out_mm, misfit, prior, residual, scanned, swing
from tests.real.sleeve_recording import baselines, folder

LEADERS = 4
BASE, JOINT = 8, 3  # iterations
AGAIN = 0.01  # of a prior's deviation


def columns(θ: Values, at: Places, swung: Sequence[tuple[dict[str, float], Places]]) -> Array:
    """Derivatives [residuals, K] of the residual from simulations with one parameter changed each."""
    r, found = residual(θ, at), []
    for changed, places in swung:
        (step,) = (value - θ.get(name, 0.0) for name, value in changed.items() if value != θ.get(name, 0.0))
        found.append((residual({name: changed[name] for name in θ}, places) - r) / step)
    return np.stack(found, 1)


def foretold(θ: Values, at: Places, J: Array, u: Array) -> tuple[float, float]:
    """Strength and gain of a signature u [residuals] beside the base's columns J [residuals, K]."""
    P, _ = np.linalg.qr(J)
    r = residual(θ, at)
    left, r = u - P @ (P.T @ u), r - P @ (P.T @ r)
    return float(-(left @ r) / (left @ left)), float((left @ r) ** 2 / (left @ left))


def closed(before: float, after: float) -> float:
    """Share of the closable gap that is closed; the floor is the mean trajectory's."""
    floor = float(np.mean([b for _, b in baselines().values()]))
    return (before**2 - after**2) / (before**2 - floor**2)


def mean_mm(at: Places, places: Sequence[int] | None = None) -> tuple[float, float]:
    """Means over places of `held_out_mm`."""
    found = held_out_mm(at)
    return tuple(float(np.mean([found[p][k] for p in places or found])) for k in (0, 1))


def main() -> None:
    """Print every suspect, the leaders fitted, and millimetres on what was kept out."""
    if not folder().is_dir():
        sys.exit(f"the recordings are not at {folder()}; set PHYSAVATAR_REAL_DATA")
    begun, effects = time.perf_counter(), suspects(library().values())
    with Pool(limit_s=600.0) as pool:
        θ, at = fitted(scanned(), iterations=BASE, run=pool.map, tell=_tell)
        probes = [{**θ, name: θ[name] + STEP * prior(name)[1]} for name in θ]
        again = [{name: value + sign * AGAIN * prior(name)[1] for name, value in θ.items()} for sign in (-2, -1, 1, 2)]
        ahead = [{**θ, **dict.fromkeys(e.columns, 0.0), c: s.typical} for e in effects for c, s in zip(e.columns, e.strengths, strict=True)]
        swung = pool.map(swing, [*probes, *again, *ahead])
        near, others, effects_swung = swung[: len(probes)], swung[len(probes) : len(probes) + len(again)], swung[len(probes) + len(again) :]
        J = columns(θ, at, list(zip(probes, near, strict=True)))
        chance = float(np.ptp([misfit(θ, o) for o in (at, *others)]))
        rows = []
        for changed, places in zip(ahead, effects_swung, strict=True):
            (name,) = (n for n, v in changed.items() if n not in θ and v)
            if places:
                strength, gain = foretold(θ, at, J, columns(θ, at, [({**θ, name: changed[name]}, places)])[:, 0])
                _, _, low, high = prior(name)
                rows.append({"name": name, "typical": changed[name], "gain_at_typical": misfit(θ, at) - misfit(θ, places)})
                rows[-1] |= {"foretold": float(np.clip(strength, low, high)), "gain_foretold": gain}
        rows.sort(key=lambda row: -max(row["gain_at_typical"], row["gain_foretold"]))
        for row in rows[:LEADERS]:
            typical = row["gain_at_typical"] > row["gain_foretold"]
            first = {**θ, **dict.fromkeys(_beside(row["name"]), 0.0), row["name"]: row["typical"] if typical else row["foretold"]}
            found, places = fitted(first, iterations=JOINT, run=pool.map, tell=_tell)
            row |= {
                "fitted": found,
                "misfit": misfit(found, places),
                "held_out_mm": mean_mm(places),
                "left_out_mm": mean_mm(places, LEFT_OUT),
            }
            row |= {"closed": closed(mean_mm(at)[1], mean_mm(places)[1]), "better_places": _better(at, places)}
            _tell(f"{row['name']}: {row}")
    answer = {
        "base": {"fitted": θ, "misfit": misfit(θ, at), "held_out_mm": mean_mm(at), "left_out_mm": mean_mm(at, LEFT_OUT)},
        "chance": chance,
        "suspects": rows,
        "painted_mm": float(np.mean([a for a, _ in baselines().values()])),
        "floor_mm": float(np.mean([b for _, b in baselines().values()])),
        "seconds": time.perf_counter() - begun,
    }
    if os.environ.get("JSON"):
        json.dump(answer, sys.stdout, indent=1)
        return
    _print(answer)


def _beside(column: str) -> tuple[str, ...]:
    (columns,) = (e.columns for e in library().values() if column in e.columns)
    return columns


def _better(before: Places, after: Places) -> int:
    """Of the 14 places, those that are nearer on repeats 4 and 5."""
    a, b = held_out_mm(before), held_out_mm(after)
    return sum(b[p][1] < a[p][1] for p in a)


def _print(answer: dict) -> None:
    base = answer["base"]
    print(f"painted {answer['painted_mm']:.2f} mm, mean trajectory {answer['floor_mm']:.2f} mm")
    print(
        f"base: misfit {base['misfit']:.0f}, chance {answer['chance']:.0f}; raw, motion [mm] {base['held_out_mm']}, places left out {base['left_out_mm']}"
    )
    print(
        "suspect | at typical: gain | foretold: strength, gain | fitted: strength, misfit, raw and motion [mm], left out, closed, better places of 14"
    )
    for row in answer["suspects"]:
        text = f"{row['name']} | {row['typical']:.3g}: {row['gain_at_typical']:.0f} | {row['foretold']:.3g}, {row['gain_foretold']:.0f}"
        if "fitted" in row:
            mm = " ".join(f"{v:.2f}" for v in (*row["held_out_mm"], *row["left_out_mm"]))
            text += f" | {row['fitted'][row['name']]:.3g}, {row['misfit']:.0f}, {mm}, {row['closed']:.2f}, {row['better_places']}"
        print(text)
    print(f"{answer['seconds']:.0f} s")


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
