"""Garment parameters by Gauss–Newton on the tangents of one replay of the whole recording (`windowed_fit.py` cuts it into windows).

    minimise over θ = (log κ_s, log κ_b)   Σ 3 ρ(s),    ρ(s) = s² where s ≤ δ,  2 δ s − δ² beyond,    s = |x̂ − x(θ)|/(√3 σ), over free, seen vertices

δ = 2.5 max(1, median s) of the replay that a step begins at, and holds for what the step is compared with: a δ that fell with the median
would let outliers get worse and call it descent. Without air, motion depends on κ_s/ρ and κ_b/ρ only (all of inertia, gravity, elasticity,
barrier and friction scale with the density), so the density is held and the ratios are what is reported. Levenberg damping within a box,
|Δθ_p| ≤ `LARGEST_STEP`; a proposal whose simulation fails or whose loss is higher shortens the step. The horizon grows: a third of a second
is fitted first, in which derivatives hold and a step costs little, until a proposal fails there; then the whole, gone on with from that
replay's last frame. Residuals of neighbouring vertices and frames move together, so blocks of `BLOCK` frames, not vertices, are taken as
independent: the covariance is that of the jackknife over blocks (Tukey 1958; the CR3 estimate of Bell & McCaffrey 2002, which unlike the
sandwich does not promise too much where blocks are few), and 90 % are Student's for as many blocks as there are.

Source: Huber 1964; Levenberg 1944; Stark & Parker 1995 (least squares in a box); Pires, Vautard & Talagrand 1996 (quasi-static
assimilation: from a short stretch, whose loss has few minima, to a long one that has many). Limits: what the first third of a second does
not tell may move by its noise there.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear
from scipy.stats import norm
from scipy.stats import t as student
from typing_extensions import override

from tasks.cloth.base_parameters import PARAMETERS, moved
from tasks.cloth.base_refit import STUCK
from tasks.cloth.scene import FORGETFUL, FrameMemory, Replay, Scene, replay, window
from tasks.simulator import Fabric, Frame, Standing

Array = NDArray[np.float64]

LARGEST_STEP = 1.2  # of a logarithm: a factor of 3.3 per iteration
HUBER = 2.5
BLOCK = 5  # frames
SETTLED = 0.02  # of a logarithm
RCOND = 1e-10  # directions that the data hardly touch stay where they are
UNKNOWN = "what mesh and step do to the answer is not known, so neither is how far it may be off"
PROPOSALS = 3  # per iteration on the whole, each shorter than the last
NEAR_S = 0.33  # [s] the first horizon: beyond it derivatives do not hold in every cloth (`windows.py`)


@dataclass(frozen=True)
class Normal:
    """Normal equations per block of frames: g [B, P] = Jᵀ W r and A [B, P, P] = Jᵀ W J, in standard deviations of the observation.

    common: covariance [P, P] of what errs alike in all blocks, of which their scatter says nothing (`numerics.common_error`); NaN where it
    could not be computed, and then no interval is.
    """

    g: Array
    A: Array
    common: Array | float = 0.0

    @property
    def step(self) -> Array:
        """The undamped Gauss–Newton step [P]; 0 along what the data do not touch, NaN where nothing was simulated."""
        if not np.isfinite(self.A).all():
            return np.full(self.g.shape[1], np.nan)
        return _solved(self.A.sum(0), self.g.sum(0))

    @property
    def covariance(self) -> Array:
        """Of the parameters [P, P]: what blocks tell, and what they have in common."""
        return self._of_blocks + self.common

    @property
    def half_width(self) -> Array:
        """Of 90 % intervals [P]: Student's for what blocks tell, B of them say B − 1 times how far they scatter (infinite for one); the
        normal one for what they have in common, whose size is not told by blocks. The two are independent, so their squares add.
        """
        blocks, common = np.diag(self._of_blocks), np.diag(np.broadcast_to(self.common, self._of_blocks.shape))
        return np.sqrt(self.quantile**2 * blocks + norm.ppf(0.95) ** 2 * common)

    @property
    def _of_blocks(self) -> Array:
        """By the jackknife over blocks, which needs no small errors, and the covariance of the noise itself beside it [P, P]."""
        A, g, B = self.A.sum(0), self.g.sum(0), len(self.g)
        if not np.isfinite(A).all():
            return np.full(A.shape, np.nan)
        without = [_solved(A - a, g - b) for a, b in zip(self.A, self.g, strict=True)]
        spread = np.array(without) - np.mean(without, 0)
        return spread.T @ spread * (B - 1) / B + np.linalg.pinv(A, rcond=RCOND, hermitian=True)

    @property
    def quantile(self) -> float:
        """Half the width of a 90 % interval in standard deviations of what blocks tell; infinite for one block."""
        return float(student.ppf(0.95, len(self.g) - 1)) if len(self.g) > 1 else np.inf


def _solved(A: Array, g: Array) -> Array:
    return np.linalg.pinv(A, rcond=RCOND, hermitian=True) @ g


@dataclass(frozen=True)
class Fit:
    """The fabric found, its normal equations, the last replay, the loss per iteration, how it ended and what had to be retried.

    noise_share: of the stated noise, what the recording showed it to be (`windowed_fit.py`). at_ends: parameter -> at which end of a
    narrower range than `BOUNDS` it lies, where the search had one (`adam_fd.py`).
    """

    fabric: Fabric
    normal: Normal
    replay: Replay
    history: tuple[dict[str, float], ...]
    ending: str
    reasons: tuple[str, ...] = ()
    noise_share: float = 1.0
    at_ends: Mapping[str, str] = field(default_factory=dict)

    @property
    def covariance(self) -> Array:
        """Of the logarithms [P, P]."""
        return self.normal.covariance


@dataclass(frozen=True)
class Progress:
    """Where a fit stands after some iterations: enough to go on with the same bits. `history` holds the figures of every fabric accepted."""

    fabric: Fabric
    damping: float = 1e-3
    history: tuple[dict[str, float], ...] = ()
    ending: str = ""
    reasons: tuple[str, ...] = ()

    def accepted(self, frames: int) -> int:
        """How many fabrics were accepted on a horizon of so many frames, the first one included."""
        return sum(row["frames"] == frames for row in self.history)


def fit(
    scene: Scene,
    start: Progress,
    *,
    iterations: int = 5,
    on_iteration: Callable[[Progress], None] = lambda progress: None,
    memory: FrameMemory = FORGETFUL,
) -> Fit:
    """Fit `PARAMETERS` from `start` with at most `iterations` accepted steps on each horizon; `on_iteration` hears of each."""
    state, lengths = start, horizons(len(scene.observed), scene.fps)
    reached = Reached(memory, lengths[0])
    for frames in lengths:
        if state.history and frames < state.history[-1]["frames"]:
            continue
        seen, whole = window(scene, slice(0, frames), scene.x0, scene.v0), frames == len(scene.observed)
        reached.horizon = frames
        state, now = _fitted(state, seen, iterations, PROPOSALS if whole else 1, on_iteration, reached)
        if not now.complete:
            break
        if not whole:
            state = replace(state, ending="")
    return Fit(state.fabric, normal_equations(seen, now), now, state.history, state.ending, state.reasons)


def horizons(frames: int, fps: float) -> tuple[int, ...]:
    """How many of the first frames are replayed, one after the other: as many as derivatives hold for, where that is less than half, then all."""
    near = 1 + round(NEAR_S * fps)
    return (near, frames) if 2 * near < frames else (frames,)


def _fitted(
    state: Progress,
    scene: Scene,
    iterations: int,
    proposals: int,
    on_iteration: Callable[[Progress], None],
    memory: FrameMemory,
) -> tuple[Progress, Replay]:
    """Gone on with until it ends on this horizon."""
    now, frames = replay(scene, state.fabric, tangents=PARAMETERS, memory=memory), len(scene.observed)
    told = state.reasons if state.accepted(frames) else ()  # gone on with after a kill: what this replay needed is told already
    state = replace(state, reasons=(*state.reasons, *(reason for reason in now.reasons if reason not in told)))
    if not now.complete:
        fabric = f"κ_s {state.fabric.membrane:.3g}, κ_b {state.fabric.bending:.3g}"
        return replace(state, ending=f"the simulation cannot follow the recording with {fabric}: {now.ending}"), now
    if not state.accepted(frames):
        state = replace(state, damping=Progress.damping, history=(*state.history, _row(scene, now, state.fabric)))
    while not state.ending:
        if state.accepted(frames) > iterations:
            state = replace(state, ending=f"stopped after {iterations} iterations")
            break
        on_iteration(state)
        state, now = _iterate(scene, state, now, proposals, memory)
    return state, now


class Reached(FrameMemory):
    """Remembers up to so many frames of every replay, beside what `memory` keeps of the one in progress: the whole goes on where the first
    horizon ended.

    horizon: frames of the replay that asks; `memory` may have kept more of them.
    """

    def __init__(self, memory: FrameMemory, frames: int) -> None:
        self.memory, self.frames, self.horizon = memory, frames, frames
        self.known: dict[Fabric, tuple[Sequence[Frame], Standing | None]] = {}

    @override
    def recall(self, fabric: Fabric) -> tuple[Sequence[Frame], Standing | None]:
        kept, standing = self.memory.recall(fabric)
        return (kept[: self.horizon], standing) if kept else self.known.get(fabric, ((), None))

    @override
    def keep(self, fabric: Fabric, frames: Sequence[Frame], standing: Standing | None) -> None:
        self.memory.keep(fabric, frames, standing)
        if standing is not None and len(frames) <= self.frames:
            self.known[fabric] = (tuple(frames), standing)

    @override
    def forget(self) -> None:
        self.memory.forget()


class Objective(Protocol):
    """What says how well a fabric explains a scene; NaN where the simulation fails."""

    def losses(self, scene: Scene, fabrics: Sequence[Fabric]) -> list[float]:
        """What is minimised, of several fabrics to be compared with the first."""
        ...

    def normal(self, scene: Scene, fabric: Fabric) -> Normal:
        """Linearised at a fabric."""
        ...


class WholeReplay:
    """One replay of everything: the objective of `fit`."""

    def losses(self, scene: Scene, fabrics: Sequence[Fabric]) -> list[float]:
        """Huber's, δ that of the first one that can be simulated."""
        replays = [replay(scene, fabric) for fabric in fabrics]
        δ = next((turning(scene, at) for at in replays if at.complete), np.nan)
        return [loss(scene, at, δ) if at.complete else np.nan for at in replays]

    def normal(self, scene: Scene, fabric: Fabric) -> Normal:
        """By blocks of frames."""
        return normal_equations(scene, replay(scene, fabric, tangents=PARAMETERS))


def _iterate(scene: Scene, state: Progress, now: Replay, proposals: int, memory: FrameMemory) -> tuple[Progress, Replay]:
    """One accepted Levenberg step, or the end."""
    normal = normal_equations(scene, now)
    g, A = normal.g.sum(0), normal.A.sum(0)
    damping, reasons, δ, simulated = state.damping, state.reasons, turning(scene, now), False
    for _ in range(proposals):
        held = A + damping * np.diag(np.diag(A)) + 1e-12 * np.trace(A) * np.eye(len(A))
        step = within(held, g, LARGEST_STEP)
        fabric, _ = moved(state.fabric, step)
        tried = replay(scene, fabric, tangents=PARAMETERS, memory=memory)
        reasons = (*reasons, *tried.reasons)
        if tried.complete and loss(scene, tried, δ) < loss(scene, now, δ):
            ending = "converged" if np.abs(step).max() < SETTLED else ""
            return Progress(fabric, max(damping / 10, 1e-4), (*state.history, _row(scene, tried, fabric)), ending, reasons), tried
        damping, simulated = max(damping * 20, 0.1), simulated or tried.complete
    ending = "converged: no shorter step lowers the loss" if simulated else f"{STUCK}; the simulation of every step failed: {tried.ending}"
    return replace(state, ending=ending, reasons=reasons), now


def within(A: Array, g: Array, most: float) -> Array:
    """The step [P] that minimises ½ sᵀA s − gᵀs over |s_p| ≤ most: what one parameter may not do, the others are asked to do."""
    L = np.linalg.cholesky(A)
    return lsq_linear(L.T, solve_triangular(L, g, lower=True), (-most, most), method="bvls").x


def turning(scene: Scene, at: Replay) -> float:
    """δ, in standard deviations: what the simulation can be blamed for at best, noise and typical misfit."""
    return HUBER * max(1.0, float(np.median(_size(_residual(scene, at)))))


def loss(scene: Scene, at: Replay, δ: float | None = None) -> float:
    """Huber's, mean over vertices and frames, in squared standard deviations; δ is the replay's own where losses are not compared."""
    s = _size(_residual(scene, at))
    δ = turning(scene, at) if δ is None else δ
    return float(np.sum(3 * np.where(s <= δ, s**2, 2 * δ * s - δ**2)) / max(len(s), 1))


def _residual(scene: Scene, at: Replay) -> Array:
    """In standard deviations [n, 3]."""
    return scene.whitened(scene.observed - at.x)


def _size(r: Array) -> Array:
    """s [n], per coordinate."""
    return np.linalg.norm(r, axis=1) / np.sqrt(3)


def normal_equations(scene: Scene, at: Replay) -> Normal:
    """Linearised at a replay, by blocks of `BLOCK` frames; NaN for a replay that ended early."""
    if not at.complete:
        return Normal(np.full((1, len(PARAMETERS)), np.nan), np.full((1, len(PARAMETERS), len(PARAMETERS)), np.nan))
    r = _residual(scene, at)
    w = np.minimum(1.0, turning(scene, at) / np.maximum(_size(r), 1e-12))  # ρ′(s)/2s
    J = scene.whitened(np.stack([at.columns[n] for n in PARAMETERS], -1))  # [n, 3, P]
    g, A = np.einsum("n,ncp,nc->np", w, J, r), np.einsum("n,ncp,ncq->npq", w, J, J)
    block = (np.nonzero(scene.compared)[0] - 1) // BLOCK
    present = np.unique(block)
    return Normal(np.stack([g[block == b].sum(0) for b in present]), np.stack([A[block == b].sum(0) for b in present]))


def rms_mm(scene: Scene, at: Replay) -> float | None:
    """Root mean square distance to what was observed, as far as the replay goes; None where it did not begin."""
    T = len(at.x)
    misfit = (scene.observed[:T] - at.x)[scene.compared[:T]]
    return float(1e3 * np.sqrt(np.mean(np.sum(misfit**2, 1)))) if len(misfit) else None


def _row(scene: Scene, at: Replay, fabric: Fabric) -> dict[str, float]:
    return {
        "frames": len(scene.observed),
        "loss": loss(scene, at),
        "huber_delta": turning(scene, at),
        "rms_mm": rms_mm(scene, at),
        "kappa_s": fabric.membrane,
        "kappa_b": fabric.bending,
    }
