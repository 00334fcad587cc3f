"""Two processes that ask for one artifact at the same moment, again and again."""

import multiprocessing
import os
from pathlib import Path
from typing import Any

import numpy as np

from storage_schemas.store import Store
from tasks.stage import Job, Parameters, stage
from tests.service.tiny import Tiny


class RaceParameters(Parameters):
    number: int = 0
    log: str = ""


@stage("capture", version=1, pool="vision", timeout_s=60)
def compute(job: Job, parameters: RaceParameters) -> Tiny:
    line = os.open(parameters.log, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(line, f"{parameters.number}\n".encode())
    os.close(line)
    return Tiny(values=np.full((1, 3), parameters.number, np.float32), seconds=0.0)


def race(place: Path, times: int) -> tuple[int, int]:
    """How many artifacts there are after `times` races of two, and how often one was computed."""
    context = multiprocessing.get_context("spawn")
    gate = context.Barrier(2)
    runners = [context.Process(target=_run, args=(gate, str(place), times)) for _ in range(2)]
    for runner in runners:
        runner.start()
    for runner in runners:
        runner.join()
    return len(Store(place / "store").list()), len((place / "computed").read_text().splitlines())


def _run(gate: Any, place: str, times: int) -> None:
    store = Store(Path(place) / "store")
    for number in range(times):
        gate.wait()
        compute.run(store, "ann", "one", {}, RaceParameters(number=number, log=f"{place}/computed"))
