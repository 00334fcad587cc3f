"""The recorded sleeve, fitted on repeats 1–3 and 11 places, reported on repeats 4 and 5 and on 3 places that the fit did not see.

    python -m tests.benchmarks.sleeve_fit          ITERATIONS=8          JSON=1: JSON on stdout

Millimetres in 3-D beside the fabric painted on the arm and the mean trajectory of repeats 1–3, both recomputed: as they are, and without
the constant offset of each place on repeats 1–3, which those two are without. One iteration takes a simulation per parameter and three
more.
"""

import json
import os
import sys
import time

import numpy as np

from tasks.child_process import Pool
from tests.real.sleeve_fit import LEFT_OUT, fitted, held_out_mm, scanned, start, swing
from tests.real.sleeve_recording import baselines, folder

COLUMNS = ("guessed", "guessed_motion", "fitted", "fitted_motion", "painted", "mean_trajectory")


def main() -> None:
    """Print the table."""
    if not folder().is_dir():
        sys.exit(f"the recordings are not at {folder()}; set PHYSAVATAR_REAL_DATA")
    begun, first = time.perf_counter(), swing(start())
    if not first:
        sys.exit("the first simulation failed")
    with Pool(limit_s=600.0) as pool:
        iterations = int(os.environ.get("ITERATIONS", "8"))
        θ, at = fitted(scanned(), iterations=iterations, run=pool.map, tell=lambda text: print(text, file=sys.stderr, flush=True))
    before, after, base = held_out_mm(first), held_out_mm(at), baselines()
    rows = [
        {"place": p, "left_out": p in LEFT_OUT} | dict(zip(COLUMNS, (*before[p], *after[p], *base[p]), strict=True)) for p in sorted(after)
    ]
    if os.environ.get("JSON"):
        json.dump({"rows": rows, "fitted": θ, "seconds": time.perf_counter() - begun}, sys.stdout, indent=1)
        return
    print("place | guessed | its motion | fitted | its motion | painted on the arm | mean trajectory   [mm, repeats 4 and 5]")
    for row in rows:
        print(f"{row['place']:>5}{'*' if row['left_out'] else ' '} | " + " | ".join(f"{row[n]:.1f}" for n in COLUMNS))
    for label, chosen in (("all", rows), ("left out *", [r for r in rows if r["left_out"]])):
        print(f"mean, {label} | " + " | ".join(f"{np.mean([r[n] for r in chosen]):.2f}" for n in COLUMNS))
    print(", ".join(f"{k} {v:.3g}" for k, v in θ.items()))
    print(f"{time.perf_counter() - begun:.0f} s")


if __name__ == "__main__":
    main()
