"""A rival of the diagnosis answers from the same files: read, let it reply, predict what is blind."""

import os
import time
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from flows import gap
from tasks.child_process import Pool
from tasks.exam.rivals.answer import answer
from tasks.exam.rivals.library import rivals
from tasks.exam.rivals.rival import Case, Rival
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
    inputs = gap.read(gap.Request(tuple(tracks), predict=predict, out=out, without=tuple(without)))
    with Pool(limit_s=LIMIT_S, at_once=os.cpu_count() or 1) as pool:
        reply = rival.reply(Case(inputs.garment.model, inputs.garment.recordings, inputs.effects, pool.map))
        gap.predict(pool, out, inputs.blind, reply.before, reply.after)
    return answer(rival, reply, seconds=time.perf_counter() - start)
