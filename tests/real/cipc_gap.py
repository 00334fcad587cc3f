"""Recordings by a simulator that nobody here wrote: what does `skirt_drag` have that `skirt_base` has not, and `skirt_friction_04` that
`skirt_friction_0` has not?

The base model is that of the recording without the effect (its parameters are known): C-IPC's integrator, material and contact rule. The
diagnosis sees seven windows of ten; the others are kept out.

    python -m tests.real.cipc_gap [skirt_drag | skirt_friction_04 | skirt_base]
"""

import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, replace

import numpy as np

from tasks.child_process import Pool
from tasks.cloth.shooting import Map
from tasks.cloth.start_state import States
from tasks.cloth.windows import Recording, windows
from tasks.effects.effect import Effect, Motion, Subject
from tasks.effects.library import library, suspects
from tasks.effects.model import Model
from tasks.gap.confirmation import Confirmed, confirmed, decided
from tasks.gap.gathered import Gathered, split
from tasks.gap.screening import screen
from tasks.gap.trials import Trials
from tests.benchmarks.simulator import AS_CIPC, recording

FPS = 25.0
BASE = {"skirt_base": "skirt_base", "skirt_drag": "skirt_base", "skirt_friction_04": "skirt_friction_0"}
NOISE = 2e-4  # [m] one step of ours lands within 0.15 mm of C-IPC's in the median


def data_of(name: str) -> tuple[Model, Gathered]:
    """The base model in its known fabric, and the run with the states that C-IPC's own positions give."""
    cloth, fabric, collider, *_ = recording(BASE[name])
    x, c = recording(name)[3:]
    subject = Subject(cloth, fabric, collider, np.full(len(cloth.x_rest), "free"), FPS)
    v = np.zeros_like(x)
    v[1:] = (x[1:] - x[:-1]) * FPS  # backward Euler's own velocity
    seen = Recording(collider, Motion(c, x[:, cloth.boundary]), x, np.full(x.shape[:2], NOISE))
    cut = tuple(replace(w, start=max(w.start, 1)) for w in windows([seen], FPS))
    return Model(subject, AS_CIPC), Gathered(
        (seen,), (States(x, v, "converged"),), tuple(replace(w, length=w.length - (w.start == 1)) for w in cut)
    )


def diagnosed(model: Model, data: Gathered, effects: Sequence[Effect], run: Map) -> Confirmed:
    """What the recording has that the model, in its known fabric, has not: the base is not refitted."""
    train, kept = split(data)
    found = screen(model, train, effects, iterations=0, run=run, tell=_tell)
    trials = Trials(found, model, train, effects, run, _tell, quick=False)
    trials.settle()
    return confirmed(trials, decided(trials), kept, apart=False)


def main() -> None:
    """Print the verdict, what it rests on, and what it closes on the windows kept out."""
    name, start = (sys.argv[1:] or ["skirt_drag"])[0], time.perf_counter()
    model, data = data_of(name)
    with Pool(limit_s=3600.0) as pool:
        said = diagnosed(model, data, suspects(library().values()), pool.map)
    rows = [
        {"class": c.names, "probability": c.probability, "strength": c.fitted.strengths if c.fitted else {}}
        for c in said.verdict.ranking[:6]
    ]
    answer = {
        "recording": name,
        "verdict": said.verdict.kind,
        "class": said.verdict.classes,
        "reason": said.verdict.reason,
        "ranking": rows,
    }
    print(json.dumps({**answer, "held_out": asdict(said.gap), "seconds": time.perf_counter() - start}, indent=1))


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
