"""What a killed fit leaves behind: where a search by differences stands, and the frames of the replay it was in.

A fit that is begun again must end as if nobody had killed it, and a replay taken up at a frame does not: its integrator has lost its history. So a replay
begins anew, unless the process has died in it `DEATHS` times: then the simulation is held to be the cause, and goes on from its last frame in smaller steps.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from typing_extensions import override

from tasks.cloth.adam_fd import Descent
from tasks.cloth.scene import FrameMemory
from tasks.simulator import Fabric, Frame


def save_descent(path: Path, descent: Descent) -> None:
    """Where a search by finite differences stands."""
    arrays = {name: getattr(descent, name).tolist() for name in ("θ", "first", "second", "best")}
    _write(path, json.dumps({**arrays, "history": descent.history}).encode())


def load_descent(path: Path, otherwise: Descent) -> Descent:
    """What was saved, or the other start."""
    if not path.exists():
        return otherwise
    kept = json.loads(path.read_text())
    return Descent(*(np.array(kept[name]) for name in ("θ", "first", "second", "best")), tuple(kept["history"]))


DEATHS = 3


class FrameFile(FrameMemory):
    """Frames of one replay in one file, rewritten after every frame; recalled only for the very fabric they were simulated with, after `DEATHS`."""

    def __init__(self, path: Path) -> None:
        self.path, self.deaths = path, 0

    @override
    def recall(self, fabric: Fabric) -> Sequence[Frame]:
        try:
            with np.load(self.path) as kept:
                arrays = dict(kept)
        except (FileNotFoundError, BadZipFile, ValueError, EOFError):
            return ()
        self.path.unlink()
        same = str(arrays["fabric"]) == _name(fabric)
        self.deaths = int(arrays["deaths"]) + 1 if same else 0
        if self.deaths < DEATHS:
            return ()
        names = [str(n) for n in arrays["names"]]
        return [
            Frame(
                index=i,
                x=arrays["x"][i],
                v=arrays["v"][i],
                collider=arrays["collider"][i],
                tangents={n: (arrays["dx"][i, k], arrays["dv"][i, k]) for k, n in enumerate(names)},
                newton_iterations=int(arrays["newton"][i]),
                seconds=float(arrays["seconds"][i]),
            )
            for i in range(len(arrays["x"]))
        ]

    @override
    def keep(self, fabric: Fabric, frames: Sequence[Frame]) -> None:
        names = list(frames[0].tangents)
        shape = (len(names), *frames[0].x.shape)
        columns = [np.array([[f.tangents[n][k] for n in names] for f in frames]).reshape(len(frames), *shape) for k in (0, 1)]
        aside = self.path.with_suffix(".tmp")
        with aside.open("wb") as file:
            np.savez(
                file,
                fabric=np.array(_name(fabric)),
                deaths=np.array(self.deaths),
                names=np.array(names, dtype=np.str_),
                x=np.stack([f.x for f in frames]),
                v=np.stack([f.v for f in frames]),
                collider=np.stack([f.collider for f in frames]),
                dx=columns[0],
                dv=columns[1],
                newton=np.array([f.newton_iterations for f in frames]),
                seconds=np.array([f.seconds for f in frames]),
            )
        aside.replace(self.path)

    @override
    def forget(self) -> None:
        self.path.unlink(missing_ok=True)
        self.deaths = 0


def _name(fabric: Fabric) -> str:
    return json.dumps(asdict(fabric))


def _write(path: Path, content: bytes) -> None:
    aside = path.with_suffix(".tmp")
    aside.write_bytes(content)
    aside.replace(path)
