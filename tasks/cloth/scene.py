"""What one garment is fitted on: its cloth, what drives it, and what was observed of it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.perseverance import PATIENT, Drive, Patience, persevere
from tasks.simulator import Cloth, Collider, Fabric, Frame, Settings, Standing

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scene:
    """One garment over T frames.

    collider_motion [T, C, 3] m; boundary_motion [T, B, 3] m; start x0 [V, 3] m and v0 [V, 3] m/s; observed [T, V, 3] m (NaN where not
    seen); noise_m [T, V], the standard deviation of an observed coordinate; fps [1/s]; noise_cov [T, V, 3, 3] m² where the tracker gives
    one.
    """

    cloth: Cloth
    collider: Collider
    collider_motion: Array
    boundary_motion: Array
    x0: Array
    v0: Array
    observed: Array
    noise_m: Array
    fps: float
    settings: Settings
    patience: Patience = PATIENT
    noise_cov: Array | None = None

    @property
    def compared(self) -> NDArray[np.bool_]:
        """Which observations count [T, V]: seen, free, and after the start."""
        free = np.ones(self.observed.shape[1], bool)
        free[self.cloth.boundary] = False
        compared = np.isfinite(self.observed).all(-1) & free
        compared[0] = False
        return compared

    def whitened(self, d: Array) -> Array:
        """Differences d [T, V, 3, ...] m at what is compared, in standard deviations of the observation [n, 3, ...]."""
        on = self.compared
        if self.noise_cov is None:
            return d[on] / self.noise_m[on].reshape(-1, *(1,) * (d.ndim - 2))
        L = np.linalg.cholesky(self.noise_cov[on])
        return np.linalg.solve(L, d[on].reshape(len(L), 3, -1)).reshape(d[on].shape)

    @property
    def drive(self) -> Drive:
        """What is simulated."""
        return Drive(self.cloth, self.collider, self.collider_motion, self.boundary_motion, self.x0, self.v0, self.fps)


@dataclass(frozen=True)
class Replay:
    """A simulation of the whole scene: x [T, V, 3] m, columns name -> ∂x/∂θ [T, V, 3], Newton iterations, how it ended and what was retried."""

    x: Array
    columns: dict[str, Array]
    newton_iterations: int
    ending: str
    reasons: tuple[str, ...] = ()
    seconds: float = 0.0

    @property
    def complete(self) -> bool:
        """Whether every frame was reached."""
        return self.ending == "converged"


class FrameMemory:
    """Keeps the frames of a replay in progress where a killed process leaves them. This one forgets; the door has one that writes."""

    def recall(self, fabric: Fabric) -> tuple[Sequence[Frame], Standing | None]:
        """Frames kept of a replay with this fabric, and where it stood after them (None: it is to go on more carefully)."""
        return (), None

    def keep(self, fabric: Fabric, frames: Sequence[Frame], standing: Standing | None) -> None:
        """Remember the frames so far, and where the simulation stands."""

    def forget(self) -> None:
        """The replay is over."""


FORGETFUL = FrameMemory()


def replay(scene: Scene, fabric: Fabric, *, tangents: tuple[str, ...] = (), memory: FrameMemory = FORGETFUL) -> Replay:
    """Simulate the scene with a fabric, with the tangents of these parameters."""
    kept, standing = memory.recall(fabric)
    if kept and not set(tangents) <= set(kept[0].tangents):
        kept, standing = (), None
    if kept and standing is not None and tuple(kept[0].tangents) != tangents:
        kept, standing = (), None
    journey = persevere(
        scene.drive,
        fabric,
        scene.settings,
        tangents=tangents,
        patience=scene.patience,
        kept=kept,
        standing=standing,
        on_frame=partial(memory.keep, fabric),
    )
    memory.forget()
    frames = journey.frames
    columns = {name: np.stack([frame.tangents[name][0] for frame in frames]) for name in tangents if frames and name in frames[-1].tangents}
    newton, seconds = sum(f.newton_iterations for f in frames), sum(f.seconds for f in frames)
    return Replay(np.stack([f.x for f in frames]), columns, newton, journey.ending, journey.reasons, seconds)


def window(scene: Scene, frames: slice, x0: Array, v0: Array) -> Scene:
    """A stretch of the scene, started from its own state."""
    return replace(
        scene,
        collider_motion=scene.collider_motion[frames],
        boundary_motion=scene.boundary_motion[frames],
        observed=scene.observed[frames],
        noise_m=scene.noise_m[frames],
        noise_cov=None if scene.noise_cov is None else scene.noise_cov[frames],
        x0=x0,
        v0=v0,
    )
