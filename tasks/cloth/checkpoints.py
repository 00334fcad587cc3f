"""What a killed fit leaves behind: where a search stands, and the frames of the replay it was in.

A fit that is begun again must end as if nobody had killed it. So a replay goes on from where it stood after its last frame
(`simulator/standing.py`), to the same bits. A replay that was already going on more carefully left nothing of that kind and begins anew.
Once processes have died in a replay `DEATHS` times without getting further, the simulation is held to be the cause, and goes on from its
last frame in smaller steps. Every fabric's replay has a file of its own: a search that is begun again simulates other fabrics before it
comes to the one with which it died.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from tasks.cloth.adam_fd import Descent
from tasks.cloth.gauss_newton import Progress
from tasks.cloth.scene import FrameMemory
from tasks.simulator import Fabric, Frame, Standing

Array = NDArray
STANDING = "standing."  # before the names of the arrays that say where it stood


def save_descent(path: Path, descent: Descent) -> None:
    """Where a search by finite differences stands."""
    arrays = {name: getattr(descent, name).tolist() for name in ("θ", "first", "second", "best")}
    _write(path, json.dumps({**arrays, "history": descent.history, "reasons": descent.reasons}).encode())


def load_descent(path: Path, otherwise: Descent) -> Descent:
    """What was saved, or the other start."""
    if not path.exists():
        return otherwise
    kept = json.loads(path.read_text())
    where = (np.array(kept[name]) for name in ("θ", "first", "second", "best"))
    return Descent(*where, tuple(kept["history"]), reasons=tuple(kept["reasons"]))


def save_progress(path: Path, progress: Progress) -> None:
    """Where a fit on whole replays stands."""
    _write(path, json.dumps(asdict(progress)).encode())


def load_progress(path: Path, otherwise: Progress) -> Progress:
    """What was saved, or the other start."""
    if not path.exists():
        return otherwise
    kept = Progress(**json.loads(path.read_text()))
    return replace(kept, fabric=Fabric(**kept.fabric), history=tuple(kept.history), reasons=tuple(kept.reasons))


DEATHS = 3


class FrameFile(FrameMemory):
    """Frames of a replay in a file, rewritten after every frame; recalled only for the very fabric they were simulated with.

    stem: of the names of its files, one for the replay in progress and one for each that a process died in; path: the former.
    """

    def __init__(self, stem: Path) -> None:
        self.stem, self.path, self.deaths, self.furthest = stem, stem, 0, 0

    @override
    def recall(self, fabric: Fabric) -> tuple[Sequence[Frame], Standing | None]:
        self.path, self.deaths, self.furthest = self._of(fabric), 0, 0
        try:
            with np.load(self.path) as kept:
                arrays = dict(kept)
        except (FileNotFoundError, BadZipFile, ValueError, EOFError):
            return (), None
        self.deaths, self.furthest = int(arrays["deaths"]) + 1, int(arrays["furthest"])
        _save(self.path, arrays | {"deaths": np.array(self.deaths)})  # a frame that kills is not gone on with for ever
        stood = {name.removeprefix(STANDING): value for name, value in arrays.items() if name.startswith(STANDING)}
        if self.deaths >= DEATHS:
            return _frames(arrays), None
        return (_frames(arrays), Standing.from_arrays(stood)) if stood else ((), None)

    @override
    def keep(self, fabric: Fabric, frames: Sequence[Frame], standing: Standing | None) -> None:
        self.path = self._of(fabric)
        if len(frames) > self.furthest:
            self.deaths, self.furthest = 0, len(frames)
        names = list(frames[0].tangents)
        shape = (len(names), *frames[0].x.shape)
        columns = [np.array([[f.tangents[n][k] for n in names] for f in frames]).reshape(len(frames), *shape) for k in (0, 1)]
        arrays = {
            "deaths": np.array(self.deaths),
            "furthest": np.array(self.furthest),
            "names": np.array(names, dtype=np.str_),
            "x": np.stack([f.x for f in frames]),
            "v": np.stack([f.v for f in frames]),
            "collider": np.stack([f.collider for f in frames]),
            "dx": columns[0],
            "dv": columns[1],
            "newton": np.array([f.newton_iterations for f in frames]),
            "seconds": np.array([f.seconds for f in frames]),
        }
        stood = {} if standing is None else {STANDING + name: value for name, value in standing.as_arrays().items()}
        _save(self.path, arrays | stood)

    @override
    def forget(self) -> None:
        self.path.unlink(missing_ok=True)
        self.deaths = self.furthest = 0

    def _of(self, fabric: Fabric) -> Path:
        return self.stem.with_name(f"{self.stem.name}-{sha256(json.dumps(asdict(fabric)).encode()).hexdigest()[:16]}.npz")


def _frames(arrays: Mapping[str, Array]) -> list[Frame]:
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


def _save(path: Path, arrays: Mapping[str, Array]) -> None:
    file = BytesIO()
    np.savez(file, **arrays)
    _write(path, file.getvalue())


def _write(path: Path, content: bytes) -> None:
    aside = path.with_suffix(".tmp")
    aside.write_bytes(content)
    aside.replace(path)
