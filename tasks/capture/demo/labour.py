"""The slow work of a demo recording, in pieces for worker processes: simulating a garment, photographing a few frames.

Every piece skips what is on disk already and writes each result whole, so it can be killed and repeated. A piece depends on its arguments
alone: which process does it, and in which order, changes no bit of the result.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tasks.capture.demo.dressing import Fitting, wear
from tasks.capture.demo.files import write_whole
from tasks.capture.demo.pictures import develop
from tasks.capture.demo.rendering import Renderer, Surface
from tasks.geometry.cameras import Cameras

Array = NDArray[np.float64]


def simulate_garment(fitting: Fitting, folder: Path) -> Array:
    """Garment vertices [T, V, 3] m; states are kept in `folder`, one file per frame, and taken up from there."""
    have = {int(path.stem): _load_state(path) for path in sorted(folder.glob("[0-9]*.npz"))}

    def keep(frame: int, x: Array, v: Array) -> None:
        write_whole(folder / f"{frame:06d}.npz", lambda aside: np.savez(aside.open("wb"), x=x, v=v))

    return wear(fitting, have=have, keep=keep)


def photograph(
    frames: Sequence[int],
    vertices: Sequence[Sequence[Array]],
    *,
    surfaces: Sequence[Surface],
    cameras: Cameras,
    gains: Array,
    spp: int,
    seed: int,
    folder: Path,
) -> int:
    """Pictures and masks of all cameras at these frames, vertices [frame][surface][V, 3] m, into an ActorsHQ scale folder; how many."""
    renderer, made = None, 0
    for frame, x in zip(frames, vertices, strict=True):
        wanted = [k for k in range(len(cameras)) if not all(path.exists() for path in picture_paths(folder, cameras.names[k], frame))]
        if not wanted:
            continue
        renderer = renderer or Renderer(surfaces, x, spp=spp)
        renderer.move(x)
        for k in wanted:
            radiance, coverage = renderer.render(cameras, k, seed=_seed(seed, k, frame))
            pictures = develop(radiance, coverage, gains[k], np.random.default_rng([seed, k, frame]))
            for path, content in zip(picture_paths(folder, cameras.names[k], frame), pictures, strict=True):
                write_whole(path, content)
            made += 1
    return made


def picture_paths(folder: Path, camera: str, frame: int) -> tuple[Path, Path]:
    """Colour picture and mask of a camera at a frame in the layout of ActorsHQ."""
    return folder / f"rgbs/{camera}/{camera}_rgb{frame:06d}.jpg", folder / f"masks/{camera}/{camera}_mask{frame:06d}.png"


def _seed(seed: int, camera: int, frame: int) -> int:
    return int(np.random.SeedSequence([seed, camera, frame]).generate_state(1)[0])


def _load_state(path: Path) -> tuple[Array, Array]:
    with np.load(path) as stored:
        return stored["x"], stored["v"]
