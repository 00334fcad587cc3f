"""The recorded sleeve: simulate it from its measured pattern and the two arm sensors, and compare at every measured place, held out.

    python -m tests.benchmarks.sleeve          QUICK=1: one pair of places          JSON=1: JSON on stdout

Errors are rms over time on repeats 4 and 5, in the frame of the arm, millimetres in 3-D, beside the fabric painted on the arm at its mean of
repeats 1–3 and the mean trajectory of repeats 1–3. "motion" has the constant offset of each place removed that the simulation shows on repeats
1–3, as the painted baseline has; "raw" has not. Nothing is fitted here: fabric, friction and clamps are guesses.
"""

import json
import os
import sys
import time

import numpy as np

from tasks.simulator import Settings, simulate
from tests.real.sleeve_model import JERSEY, arm_plate, at_rest, joined, posed, raised, sleeve
from tests.real.sleeve_recording import DOWN, PAIRS, RATE, baselines, folder, in_arm_frame, read_run

HANG, RAISE, HOLD = 24, 32, 8  # frames before the recording starts


def simulated_places(pair: tuple[int, int], repeat: int, *, settings: Settings) -> tuple[dict[int, np.ndarray], str, float]:
    """Places of one run in the arm's frame [T, 3] m, how it ended, and processor seconds per frame."""
    run = read_run(pair, repeat)
    garment = sleeve()
    arm, collider = arm_plate()
    up = raised(run, RAISE)
    last = type(run)(np.zeros(HOLD), np.tile(up.s1[-1], (HOLD, 1)), np.tile(up.s2[-1], (HOLD, 1)), {})
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
            settings=settings,
        )
    )
    x = np.stack([frame.x for frame in frames])[HANG + RAISE + HOLD :]
    places = (
        {k: in_arm_frame(run, np.einsum("k,tkc->tc", w, x[:, nodes])) for k, (nodes, w) in garment.places.items()}
        if len(x) == len(run.time)
        else {}
    )
    return places, frames[-1].ending, sum(frame.seconds for frame in frames) / len(frames)


def measure(pairs: tuple[tuple[int, int], ...]) -> list[dict]:
    """One row per place."""
    settings = Settings(substeps=3, gravity=tuple(9.81 * DOWN), barrier_distance=8e-4)
    painted = baselines()
    rows = []
    for pair in pairs:
        offset_run, _, _ = simulated_places(pair, 1, settings=settings)
        held_out = {r: simulated_places(pair, r, settings=settings) for r in (4, 5)}
        for place in pair:
            offsets = [in_arm_frame(run := read_run(pair, r), run.places[place]).mean(0) for r in (1, 2, 3)]
            shift = np.mean(offsets, 0) - offset_run[place].mean(0)
            errors = {"raw": [], "motion": []}
            for r, (found, _, _) in held_out.items():
                run = read_run(pair, r)
                truth = in_arm_frame(run, run.places[place])
                errors["raw"].append(np.sum((truth - found[place]) ** 2, 1))
                errors["motion"].append(np.sum((truth - found[place] - shift) ** 2, 1))
            mm = {name: float(1e3 * np.sqrt(np.mean(e))) for name, e in errors.items()}
            rows.append(
                {
                    "place": place,
                    **mm,
                    "painted": painted[place][0],
                    "mean_trajectory": painted[place][1],
                    "seconds_per_frame": held_out[4][2],
                }
            )
    return rows


def main() -> None:
    """Print the table."""
    if not folder().is_dir():
        sys.exit(f"the recordings are not at {folder()}; set PHYSAVATAR_REAL_DATA")
    start = time.perf_counter()
    rows = measure(PAIRS[-1:] if os.environ.get("QUICK") else PAIRS)
    mean = {name: float(np.mean([row[name] for row in rows])) for name in rows[0] if name != "place"}
    if os.environ.get("JSON"):
        json.dump({"rows": rows, "mean": mean, "seconds": time.perf_counter() - start}, sys.stdout, indent=1)
        return
    names = ["raw", "motion", "painted", "mean_trajectory"]
    print("place | simulated, raw | simulated, motion | painted on the arm | mean trajectory   [mm, held out]")
    for row in [*rows, {"place": "mean", **mean}]:
        print(f"{row['place']:>5} | " + " | ".join(f"{row[name]:.1f}" for name in names))
    print(f"{mean['seconds_per_frame']:.2f} CPU s per frame, {time.perf_counter() - start:.0f} s in all")


if __name__ == "__main__":
    main()
