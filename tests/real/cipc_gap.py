"""Recordings by a simulator that nobody here wrote: what does `skirt_drag` have that `skirt_base` has not?

The base model is what made skirt_base (its parameters are known): C-IPC's integrator, material and contact rule. Only the first part of skirt_drag is
shown; the rest is held out.

    python -m tests.real.cipc_gap [skirt_drag]
"""

import json
import sys
import time
from dataclasses import replace

import numpy as np

from tasks.child_process import Pool
from tasks.cloth.start_state import States
from tasks.cloth.windows import Recording, windows
from tasks.effects.effect import Motion, Subject
from tasks.effects.library import library, suspects
from tasks.effects.model import Model
from tasks.gap.gathered import Gathered, split
from tasks.gap.screening import screen
from tasks.gap.verdict import judge
from tests.benchmarks.simulator import AS_CIPC, recording

FPS = 25.0
NOISE = 2e-4  # [m] one step of ours lands within 0.15 mm of C-IPC's in the median


def data_of(name: str) -> tuple[Model, Gathered]:
    """The base model in its known fabric, and the run with the states that C-IPC's own positions give."""
    cloth, fabric, collider, x, c = recording(name)
    subject = Subject(cloth, fabric, collider, np.full(len(cloth.x_rest), "free"), FPS)
    v = np.zeros_like(x)
    v[1:] = (x[1:] - x[:-1]) * FPS  # backward Euler's own velocity
    seen = Recording(collider, Motion(c, x[:, cloth.boundary]), x, np.full(x.shape[:2], NOISE))
    cut = tuple(replace(w, start=max(w.start, 1)) for w in windows([seen], FPS))
    return Model(subject, AS_CIPC), Gathered(
        (seen,), (States(x, v, "converged"),), tuple(replace(w, length=w.length - (w.start == 1)) for w in cut)
    )


def main() -> None:
    """Print the ranking."""
    name, start = (sys.argv[1:] or ["skirt_drag"])[0], time.perf_counter()
    model, data = data_of(name)
    train, _ = split(data)
    with Pool(limit_s=1800.0) as pool:
        found = screen(
            model, train, suspects(library().values()), iterations=0, run=pool.map, tell=lambda text: print(text, file=sys.stderr)
        )
    verdict = judge(found.hypotheses, unexplained=0.0)
    rows = [
        {"class": c.names, "probability": c.probability, "strength": c.fitted.strengths if c.fitted else {}} for c in verdict.ranking[:6]
    ]
    print(
        json.dumps(
            {"recording": name, "verdict": verdict.kind, "class": verdict.classes, "ranking": rows, "seconds": time.perf_counter() - start},
            indent=1,
        )
    )


if __name__ == "__main__":
    main()
