"""The recorded sleeve: simulate it from its measured pattern and the two arm sensors, and compare at every measured place, held out.

    python -m tests.benchmarks.sleeve          QUICK=1: one simulation for all places          JSON=1: JSON on stdout

Every run is driven by its own two sensors, three simulations per pair of places; with QUICK=1 one simulation driven by the mean swing of
repeats 1–3, on the coarse mesh of the fit, serves all places, because the arm swings alike in all runs.

Errors are rms over time on repeats 4 and 5, in the frame of the arm, millimetres in 3-D, beside the fabric painted on the arm at its mean
of repeats 1–3 and the mean trajectory of repeats 1–3. "motion" has the constant offset of each place removed that the simulation shows on
repeats 1–3, as the painted baseline has; "raw" has not. Nothing is fitted here: fabric, friction and clamps are guesses. A page with
pictures is written below the cache folder.
"""

import json
import os
import sys
import time
from pathlib import Path

import numpy as np

from tasks.simulator import Settings, simulate
from tests.benchmarks.sleeve_page import Swung, sleeve_page
from tests.real.sleeve_fit import mean_arm
from tests.real.sleeve_model import JERSEY, Sleeve, arm_plate, at_rest, joined, posed, raised, sleeve
from tests.real.sleeve_recording import DOWN, PAIRS, RATE, Run, baselines, folder, in_arm_frame, read_run

HANG, RAISE, HOLD = 24, 32, 8  # frames before the recording starts
TRAIN, HELD_OUT = (1, 2, 3), (4, 5)
SETTINGS = Settings(substeps=3, gravity=tuple(9.81 * DOWN), barrier_distance=8e-4)
COARSE = {"around": 6, "along": 9}  # cells
COLUMNS = ("raw", "motion", "painted", "mean_trajectory")


def simulated(run: Run, name: str, garment: Sleeve) -> Swung:
    """The sleeve hanging, raised, and let swing with the arm of this run."""
    arm, collider = arm_plate()
    up = raised(run, RAISE)
    last = Run(np.zeros(HOLD), np.tile(up.s1[-1], (HOLD, 1)), np.tile(up.s2[-1], (HOLD, 1)), {})
    motion = joined(at_rest(run, HANG), up, last, run)
    start = posed(garment.x_arm, motion, link=1)[0]
    clamped = garment.cloth.boundary
    frames = list(
        simulate(
            garment.cloth,
            JERSEY,
            collider,
            collider_motion=posed(arm, motion),
            boundary_motion=posed(garment.x_arm[clamped], motion, link=1),
            fps=RATE,
            x0=start,
            settings=SETTINGS,
        )
    )
    x = np.full((len(run.time), *garment.x_arm.shape), np.nan)  # frames that a failed simulation did not reach
    sys.stderr.write(f"{name}: {frames[-1].ending}, {sum(f.seconds for f in frames):.0f} CPU s\n")
    for k, frame in enumerate(frames[HANG + RAISE + HOLD :]):
        x[k] = frame.x
    return Swung(run, garment, in_arm_frame(run, x), sum(frame.seconds for frame in frames) / len(frames))


def own_swings(pair: tuple[int, int]) -> dict[int, Swung]:
    """Repeats 1, 4 and 5 of a pair, each driven by its own arm."""
    return {r: simulated(read_run(pair, r), f"places {pair}, repeat {r}", sleeve()) for r in (1, *HELD_OUT)}


def errors(pair: tuple[int, int], swung: dict[int, Swung]) -> list[dict]:
    """One row per place of the pair; swung: simulations of repeats 1, 4 and 5."""
    known, rows = baselines(), []
    for place in pair:
        offsets = [in_arm_frame(run := read_run(pair, r), run.places[place]).mean(0) for r in TRAIN]
        shift = np.mean(offsets, 0) - swung[1].at(place).mean(0)
        missed = [in_arm_frame(run := read_run(pair, r), run.places[place]) - swung[r].at(place) for r in HELD_OUT]
        rows.append(
            {
                "place": place,
                "raw": _rms_mm(missed),
                "motion": _rms_mm([r - shift for r in missed]),
                "painted": known[place][0],
                "mean_trajectory": known[place][1],
                "shift_mm": (1e3 * shift).tolist(),
                "seconds_per_frame": swung[HELD_OUT[0]].seconds_per_frame,
            }
        )
    return rows


def _rms_mm(missed: list[np.ndarray]) -> float:
    return float(1e3 * np.sqrt(np.mean([np.sum(r**2, -1) for r in missed])))


def main() -> None:
    """Print the table, and write the page."""
    if not folder().is_dir():
        sys.exit(f"the recordings are not at {folder()}; set PHYSAVATAR_REAL_DATA")
    start = time.perf_counter()
    if os.environ.get("QUICK"):
        one = simulated(mean_arm(), "mean swing", sleeve(**COARSE))
        found = {pair: dict.fromkeys((1, *HELD_OUT), one) for pair in PAIRS}
    else:
        found = {pair: own_swings(pair) for pair in PAIRS}
    rows = [row for pair, swung in found.items() for row in errors(pair, swung)]
    mean = {name: float(np.mean([row[name] for row in rows])) for name in (*COLUMNS, "seconds_per_frame")}
    file = Path(os.environ.get("PHYSAVATAR_CACHE", "~/.cache/physavatar")).expanduser() / "bench-sleeve" / "sleeve.html"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(sleeve_page(rows, mean, {pair: swung[HELD_OUT[0]] for pair, swung in found.items()}))
    sys.stderr.write(f"{file}\n")
    if os.environ.get("JSON"):
        json.dump({"rows": rows, "mean": mean, "page": str(file), "seconds": time.perf_counter() - start}, sys.stdout, indent=1)
        return
    print("place | simulated, raw | simulated, motion | painted on the arm | mean trajectory   [mm, held out]")
    for row in [*rows, {"place": "mean", **mean}]:
        print(f"{row['place']:>5} | " + " | ".join(f"{row[name]:.1f}" for name in COLUMNS))
    print(f"{mean['seconds_per_frame']:.2f} CPU s per frame, {time.perf_counter() - start:.0f} s in all")


if __name__ == "__main__":
    main()
