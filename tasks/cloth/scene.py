"""What one garment is fitted on: its cloth, what drives it, and what was observed of it."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.simulator import Cloth, Collider, Fabric, Settings, simulate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scene:
    """One garment over T frames.

    collider_motion [T, C, 3] m; boundary_motion [T, B, 3] m; start x0 [V, 3] m and v0 [V, 3] m/s; observed [T, V, 3] m (NaN where not seen);
    noise_m [T, V], the standard deviation of an observed coordinate; fps [1/s].
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

    @property
    def compared(self) -> NDArray[np.bool_]:
        """Which observations count [T, V]: seen, free, and after the start."""
        free = np.ones(self.observed.shape[1], bool)
        free[self.cloth.boundary] = False
        compared = np.isfinite(self.observed).all(-1) & free
        compared[0] = False
        return compared


@dataclass(frozen=True)
class Replay:
    """A simulation of the whole scene: x [T, V, 3] m, columns name -> ∂x/∂θ [T, V, 3], Newton iterations, and how it ended."""

    x: Array
    columns: dict[str, Array]
    newton_iterations: int
    ending: str

    @property
    def complete(self) -> bool:
        """Whether every frame was reached."""
        return self.ending == "converged"


def replay(scene: Scene, fabric: Fabric, *, tangents: tuple[str, ...] = ()) -> Replay:
    """Simulate the scene with a fabric, with the tangents of these parameters."""
    frames = list(
        simulate(
            scene.cloth,
            fabric,
            scene.collider,
            collider_motion=scene.collider_motion,
            boundary_motion=scene.boundary_motion,
            fps=scene.fps,
            x0=scene.x0,
            v0=scene.v0,
            settings=scene.settings,
            tangents=tangents,
        )
    )
    columns = {name: np.stack([frame.tangents[name][0] for frame in frames]) for name in tangents}
    return Replay(np.stack([frame.x for frame in frames]), columns, sum(f.newton_iterations for f in frames), frames[-1].ending)


def window(scene: Scene, frames: slice, x0: Array, v0: Array) -> Scene:
    """A stretch of the scene, started from its own state."""
    return replace(
        scene,
        collider_motion=scene.collider_motion[frames],
        boundary_motion=scene.boundary_motion[frames],
        observed=scene.observed[frames],
        noise_m=scene.noise_m[frames],
        x0=x0,
        v0=v0,
    )
