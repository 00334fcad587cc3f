"""A line of two small stages on two pools, deployed as the avatar's line is: what the service does, at a hundredth of the cost.

`capture` reads a text file below the recording; `cloth` sleeps for as long as the text says, in a child process, as a solver would.
Words in the text make trouble: "crash" kills the flow's process at every attempt, "refuse" is bad input. "parts:6" has `cloth` sleep as
often, and say in `parts` how many processes shared that.
"""

import os
import signal
import time
from functools import partial
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from flows.dataset import DatasetParameters
from flows.line import Line, Run
from flows.service.actor import actor_flow
from flows.service.campaign import dataset_flow
from flows.service.group import group_flow
from flows.service.joining import helper_flow
from flows.service.order import Service
from storage_schemas.fields import array
from storage_schemas.record import Record
from tasks.child_process import run_in_children
from tasks.geometry.faults import BadInput, Fault
from tasks.stage import Folder, Job, ModelFile, Parameters, stage
from tests.service.tiny_solver import slowly

HERE = Path(__file__)


class Tiny(Record, name="tiny", version=1):
    values: np.ndarray = array("frame 3", "float32", "m")
    seconds: float
    parts: int = 1


class CaptureParameters(Parameters):
    recording: Folder = None


class ClothParameters(Parameters):
    scale: float = 1.0
    model: ModelFile = None


@stage("capture", version=1, pool="vision", timeout_s=600)
def capture(job: Job, parameters: CaptureParameters) -> Tiny:
    text = (Path(parameters.recording) / "text").read_text()
    if "refuse" in text:
        raise BadInput([Fault(str(parameters.recording), "it says refuse", "say something else")])
    if "crash" in text:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.05)
    parts = next((int(word.removeprefix("parts:")) for word in text.split() if word.startswith("parts:")), 1)
    return Tiny(values=np.ones((2, 3), np.float32), seconds=float(text.split()[0]), parts=parts)


@stage("cloth", version=1, pool="simulation", timeout_s=600, retries=1, spreads=True)
def cloth(job: Job, capture: Tiny, parameters: ClothParameters) -> Tiny:
    with (job.checkpoint / "computed").open("a") as log:
        log.write("once\n")
    if capture.seconds == 0:  # tests of planning need artifacts, not solvers
        return Tiny(values=capture.values * parameters.scale, seconds=0.0)
    if capture.parts > 1:
        run = job.spread(map, 1)
        where = run(partial(part, capture.seconds), range(capture.parts))
        return Tiny(values=capture.values * parameters.scale, seconds=capture.seconds, parts=len(set(where)))
    (result,) = run_in_children(
        slowly, [(capture.seconds, parameters.scale)], limit_s=600, on_message=lambda i, m: job.progress(m, "solving")
    )
    return Tiny(values=capture.values * result, seconds=capture.seconds)


def part(seconds: float, number: int) -> int:
    """One of several parts; the process that computed it."""
    time.sleep(seconds)
    return os.getpid()


def order(run: Run) -> None:
    run(cloth, capture=run(capture))


LINE = Line({s.name: s for s in (capture, cloth)}, order)


class Settings(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    store: Path
    data: Path
    capture: CaptureParameters = CaptureParameters()
    cloth: ClothParameters = ClothParameters()
    dataset: DatasetParameters = Field(default_factory=lambda: DatasetParameters(until="cloth", keep_free_gb=0.0, in_flight=6))


def load() -> Settings:
    return Settings(store=Path(os.environ["TINY_STORE"]), data=Path(os.environ["TINY_DATA"]))


SERVICE = Service(LINE, Settings, load)
vision = group_flow(SERVICE, "vision")
simulation = group_flow(SERVICE, "simulation")
helper = helper_flow(SERVICE)
actor = actor_flow(SERVICE)
dataset = dataset_flow(SERVICE)


def recording(data: Path, actor: str, sequence: str, text: str = "0.05") -> Path:
    """Write one."""
    folder = data / actor / sequence
    folder.mkdir(parents=True)
    (folder / "text").write_text(f"{text} {actor} {sequence}")
    past = time.time() - 60
    os.utime(folder / "text", (past, past))
    return folder
