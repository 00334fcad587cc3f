"""Rivals of the diagnosis answer from the same files: read, let each reply, predict what is blind.

They share what they have in common: the base that most start from, and its blind prediction.
"""

import json
import os
import time
import traceback
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from flows.blind_prediction import BlindPrediction
from flows.gap_inputs import Request, read
from storage_schemas.durable import replace_file
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


def run(
    names: Sequence[str], tracks: Sequence[Path], *, predict: Path, out: Path, without: Sequence[str] = ()
) -> dict[str, dict[str, Any] | None]:
    """name -> answer, None of a rival that fell over. NAME.json, the answer, and NAME.npz, the blind prediction, go into the folder `out`
    as soon as there are any.

    Raises BadInput before any work starts.
    """
    asked, told = chosen(names), {}
    refuse([] if out.is_dir() else [Fault(f"--out {out}", "is not a folder", "Create it, or choose another.")])
    inputs = read(Request(tuple(tracks), predict=predict, out=out / "pred.npz", without=tuple(without)))
    assert inputs.blind is not None  # `predict` names it
    with Pool(limit_s=LIMIT_S, at_once=os.cpu_count() or 1) as pool:
        case = Case(inputs.garment.model, inputs.garment.recordings, inputs.effects, pool.map)
        blind = BlindPrediction(pool, inputs.blind)
        refit_s = 0.0
        for rival in asked:
            try:
                if rival.refits:
                    refit_s = refit_s or _seconds(lambda: case.refitted)
                told[rival.name] = _answer(rival, case, blind, refit_s if rival.refits else 0.0, out)
            except Exception:  # noqa: BLE001 - one that falls over, for whatever reason, does not take the others with it
                traceback.print_exc()
                told[rival.name] = None
    return told


def _answer(rival: Rival, case: Case, blind: BlindPrediction, refit_s: float, out: Path) -> dict[str, Any]:
    start = time.perf_counter()
    reply = rival.reply(case)
    blind.write(out / f"{rival.name}.npz", reply.before, reply.after)
    told = answer(rival, reply, seconds=refit_s + time.perf_counter() - start)
    replace_file(out / f"{rival.name}.json", json.dumps(told, indent=1, allow_nan=False).encode())
    return told


def _seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start
