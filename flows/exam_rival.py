"""A rival of the diagnosis answers from the same files: read, let it reply, predict what is blind."""

import os
import time
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from tasks.capture.tracked_geometry import read_tracked_geometry
from tasks.child_process import Pool
from tasks.effects.library import library, suspects
from tasks.effects.named import named
from tasks.exam.rivals.answer import answer
from tasks.exam.rivals.library import rivals
from tasks.exam.rivals.rival import Case, Rival
from tasks.gap.blind import predicted
from tasks.gap.garment_recordings import garment_recordings, recording
from tasks.geometry.faults import Fault, refuse

LIMIT_S = 1800.0  # of one simulation


def chosen(names: Sequence[str]) -> list[Rival]:
    """Rivals by name, in the order of the library. Raises BadInput for a name that nobody has, or a package that is not installed."""
    known = rivals()
    faults = [Fault("--rival", f"there is no rival {n!r}", f"Known are {', '.join(known)}.") for n in names if n not in known]
    found = [rival for name, rival in known.items() if name in names]
    faults += [
        Fault(f"--rival {r.name}", f"it needs {r.needs}, which is not installed", f"pip install -c constraints.txt {r.needs}")
        for r in found
        if r.needs is not None and find_spec(r.needs) is None
    ]
    refuse(faults)
    return found


def run(name: str, tracks: Sequence[Path], *, predict: Path, out: Path, without: Sequence[str] = ()) -> dict[str, Any]:
    """The rival's answer as JSON; its blind prediction goes to `out`. Raises BadInput before any work starts."""
    start = time.perf_counter()
    (rival,) = chosen([name])
    refuse(Fault(str(p), "there is no such file", "Give an NPZ of tracked geometry.") for p in (*tracks, predict) if not p.exists())
    known = library()
    left_out = named(without, known, "--without")
    effects = tuple(suspects(e for e in known.values() if e not in left_out))
    unseen = read_tracked_geometry(predict), str(predict)
    garment = garment_recordings([read_tracked_geometry(p) for p in tracks], [str(p) for p in tracks], blind=unseen)
    blind = recording(*unseen, garment, blind=True)
    with Pool(limit_s=LIMIT_S, at_once=os.cpu_count() or 1) as pool:
        reply = rival.reply(Case(garment.model, garment.recordings, effects, pool.map))
        before, after = pool.map(_predicted, [(reply.before, blind), (reply.after, blind)])
    np.savez_compressed(out, before=before.astype(np.float32), after=after.astype(np.float32))
    return answer(rival, reply, seconds=time.perf_counter() - start)


def _predicted(job):
    return predicted(*job)
