"""Garment parameters by Gauss–Newton on the tangents of one replay of the whole recording (`windowed_fit.py` cuts it into windows).

    minimise over θ = (log κ_s, log κ_b)   Σ ρ(|x̂ − x(θ)|/σ),    ρ Huber's loss, over free, seen vertices

Without air, motion depends on κ_s/ρ and κ_b/ρ only (all of inertia, gravity, elasticity, barrier and friction scale with the density), so
the density is held and the ratios are what is reported. Levenberg damping; a proposal whose simulation fails or whose loss is higher
shortens the step. Residuals of neighbouring vertices and frames move together, so blocks of `BLOCK` frames, not vertices, are taken as independent:
the covariance is that of the jackknife over blocks (Tukey 1958; the CR3 estimate of Bell & McCaffrey 2002, which unlike the sandwich does not promise
too much where blocks are few), and 90 % are Student's for as many blocks as there are.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from tasks.cloth.scene import FORGETFUL, FrameMemory, Replay, Scene, replay
from tasks.simulator import Fabric

Array = NDArray[np.float64]

PARAMETERS = ("log_membrane", "log_bending")
REFERENCE_DENSITY = 320.0  # [kg/m³] bounds hold for κ · 320/ρ: they limit what can be known, the ratios
BOUNDS = {"log_membrane": (np.log(0.02), np.log(200.0)), "log_bending": (np.log(0.1), np.log(500.0))}
LARGEST_STEP = 1.2  # of a logarithm: a factor of 3.3 per iteration
HUBER = 2.5
BLOCK = 5  # frames
SETTLED = 0.02  # of a logarithm
RCOND = 1e-10  # directions that the data hardly touch stay where they are
PROPOSALS = 3  # per iteration, each shorter than the last


@dataclass(frozen=True)
class Normal:
    """Normal equations per block of frames: g [B, P] = Jᵀ W r and A [B, P, P] = Jᵀ W J, in standard deviations of the observation."""

    g: Array
    A: Array

    @property
    def step(self) -> Array:
        """The undamped Gauss–Newton step [P]; 0 along what the data do not touch, NaN where nothing was simulated."""
        if not np.isfinite(self.A).all():
            return np.full(self.g.shape[1], np.nan)
        return _solved(self.A.sum(0), self.g.sum(0))

    @property
    def covariance(self) -> Array:
        """Of the parameters [P, P]: by the jackknife over blocks, which needs no small errors, and that of the noise itself beside it."""
        A, g, B = self.A.sum(0), self.g.sum(0), len(self.g)
        if not np.isfinite(A).all():
            return np.full(A.shape, np.nan)
        without = [_solved(A - a, g - b) for a, b in zip(self.A, self.g, strict=True)]
        spread = np.array(without) - np.mean(without, 0)
        return spread.T @ spread * (B - 1) / B + np.linalg.pinv(A, rcond=RCOND, hermitian=True)

    @property
    def quantile(self) -> float:
        """Half the width of a 90 % interval in standard deviations: Student's, B blocks say B − 1 times how far they scatter; infinite for one."""
        return float(student.ppf(0.95, len(self.g) - 1)) if len(self.g) > 1 else np.inf


def _solved(A: Array, g: Array) -> Array:
    return np.linalg.pinv(A, rcond=RCOND, hermitian=True) @ g


@dataclass(frozen=True)
class Fit:
    """The fabric found, its normal equations, the last replay, the loss per iteration, how it ended and what had to be retried."""

    fabric: Fabric
    normal: Normal
    replay: Replay
    history: tuple[dict[str, float], ...]
    ending: str
    reasons: tuple[str, ...] = ()

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


def fit(
    scene: Scene,
    start: Progress,
    *,
    iterations: int = 5,
    on_iteration: Callable[[Progress], None] = lambda progress: None,
    memory: FrameMemory = FORGETFUL,
) -> Fit:
    """Fit `PARAMETERS` from `start` with at most `iterations` accepted steps in all; `on_iteration` hears of each."""
    state, now = start, replay(scene, start.fabric, tangents=PARAMETERS, memory=memory)
    state = replace(state, reasons=(*state.reasons, *now.reasons))
    if not now.complete:
        ending = (
            f"the simulation cannot follow the recording with κ_s {state.fabric.membrane:.3g}, κ_b {state.fabric.bending:.3g}: {now.ending}"
        )
        return Fit(state.fabric, normal_equations(scene, now), now, state.history, ending, state.reasons)
    if not state.history:
        state = replace(state, history=(_row(scene, now, state.fabric),))
    while not state.ending:
        if len(state.history) > iterations:
            state = replace(state, ending=f"stopped after {iterations} iterations")
            break
        on_iteration(state)
        state, now = _iterate(scene, state, now, memory)
    return Fit(state.fabric, normal_equations(scene, now), now, state.history, state.ending, state.reasons)


class Objective(Protocol):
    """What says how well a fabric explains a scene; NaN where the simulation fails."""

    def loss(self, scene: Scene, fabric: Fabric) -> float:
        """What is minimised."""
        ...

    def normal(self, scene: Scene, fabric: Fabric) -> Normal:
        """Linearised at a fabric."""
        ...


class WholeReplay:
    """One replay of everything: the objective of `fit`."""

    def loss(self, scene: Scene, fabric: Fabric) -> float:
        """Weighted mean square of the residual."""
        now = replay(scene, fabric)
        return loss(scene, now) if now.complete else np.nan

    def normal(self, scene: Scene, fabric: Fabric) -> Normal:
        """By blocks of frames."""
        return normal_equations(scene, replay(scene, fabric, tangents=PARAMETERS))


def _iterate(scene: Scene, state: Progress, now: Replay, memory: FrameMemory) -> tuple[Progress, Replay]:
    """One accepted Levenberg step, or the end."""
    normal = normal_equations(scene, now)
    g, A = normal.g.sum(0), normal.A.sum(0)
    damping, reasons = state.damping, state.reasons
    for _ in range(PROPOSALS):
        held = A + damping * np.diag(np.diag(A)) + 1e-12 * np.trace(A) * np.eye(len(A))
        step = np.clip(np.linalg.solve(held, g), -LARGEST_STEP, LARGEST_STEP)
        fabric = moved(state.fabric, step)
        tried = replay(scene, fabric, tangents=PARAMETERS, memory=memory)
        reasons = (*reasons, *tried.reasons)
        if tried.complete and loss(scene, tried) < loss(scene, now):
            ending = "converged" if np.abs(step).max() < SETTLED else ""
            return Progress(fabric, max(damping / 10, 1e-4), (*state.history, _row(scene, tried, fabric)), ending, reasons), tried
        damping = max(damping * 20, 0.1)
    return replace(state, ending="converged: no shorter step lowers the loss", reasons=reasons), now


def logarithms(fabric: Fabric) -> Array:
    """log κ_s and log κ_b of the fabric of density 320 kg/m³ that moves like this one [P]."""
    return np.log(np.array([fabric.membrane, fabric.bending]) * REFERENCE_DENSITY / fabric.density)


def moved(fabric: Fabric, step: Array) -> Fabric:
    """The fabric whose logarithms [P] are larger by `step`, within the bounds; its density stays."""
    low, high = np.array([BOUNDS[name] for name in PARAMETERS]).T
    membrane, bending = np.exp(np.clip(logarithms(fabric) + step, low, high)) * fabric.density / REFERENCE_DENSITY
    return replace(fabric, membrane=float(membrane), bending=float(bending))


def _residual(scene: Scene, at: Replay) -> tuple[Array, Array]:
    """Residuals over their scale [n, 3], and Huber weights [n]. The scale is what the simulation can be blamed for at best: noise and typical misfit."""
    r = scene.whitened(scene.observed - at.x)
    size = np.linalg.norm(r, axis=1) / np.sqrt(3)
    δ = HUBER * max(1.0, float(np.median(size)))
    return r, np.minimum(1.0, δ / np.maximum(size, 1e-12))


def loss(scene: Scene, at: Replay) -> float:
    """Weighted mean square of the residual in standard deviations."""
    r, w = _residual(scene, at)
    return float(np.sum(w * np.sum(r**2, 1)) / max(len(r), 1))


def normal_equations(scene: Scene, at: Replay) -> Normal:
    """Linearised at a replay, by blocks of `BLOCK` frames; NaN for a replay that ended early."""
    if not at.complete:
        return Normal(np.full((1, len(PARAMETERS)), np.nan), np.full((1, len(PARAMETERS), len(PARAMETERS)), np.nan))
    r, w = _residual(scene, at)
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
        "loss": loss(scene, at),
        "rms_mm": rms_mm(scene, at),
        "kappa_s": fabric.membrane,
        "kappa_b": fabric.bending,
    }
