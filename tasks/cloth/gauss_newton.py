"""Garment parameters by Gauss–Newton on the tangents of the simulation.

    minimise over θ = (log κ_s, log κ_b)   Σ ρ(|x̂ − x(θ)|/σ),    ρ Huber's loss, over free, seen vertices

Without air, motion depends on κ_s/ρ and κ_b/ρ only (all of inertia, gravity, elasticity, barrier and friction scale with the density), so
the density is held and the ratios are what is reported. Levenberg damping; a proposal whose simulation fails or whose loss is higher
shortens the step. Intervals are cluster-robust (Liang & Zeger 1986): residuals of neighbouring vertices and frames move together, so blocks
of `BLOCK` frames, not vertices, are taken as independent.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.scene import Replay, Scene, replay
from tasks.simulator import Fabric

Array = NDArray[np.float64]

PARAMETERS = ("log_membrane", "log_bending")
REFERENCE_DENSITY = 320.0  # [kg/m³] bounds hold for κ · 320/ρ: they limit what can be known, the ratios
BOUNDS = {"log_membrane": (np.log(0.02), np.log(200.0)), "log_bending": (np.log(0.1), np.log(500.0))}
LARGEST_STEP = 1.2  # of a logarithm: a factor of 3.3 per iteration
HUBER = 2.5
BLOCK = 5  # frames
SETTLED = 0.02  # of a logarithm
PROPOSALS = 3  # per iteration, each shorter than the last


@dataclass(frozen=True)
class Fit:
    """The fabric found, covariance [P, P] of the logarithms, the last replay, the loss per iteration and how it ended."""

    fabric: Fabric
    covariance: Array
    replay: Replay
    history: tuple[dict[str, float], ...]
    ending: str


@dataclass(frozen=True)
class Progress:
    """Where a fit stands after some iterations: enough to go on with the same bits. `history` holds the figures of every fabric accepted."""

    fabric: Fabric
    damping: float = 1e-3
    history: tuple[dict[str, float], ...] = ()
    ending: str = ""


def fit(scene: Scene, start: Progress, *, iterations: int = 5, on_iteration: Callable[[Progress], None] = lambda progress: None) -> Fit:
    """Fit `PARAMETERS` from `start` with at most `iterations` accepted steps in all; `on_iteration` hears of each."""
    state, now = start, replay(scene, start.fabric, tangents=PARAMETERS)
    if not now.complete:
        ending = (
            f"the simulation cannot follow the recording with κ_s {state.fabric.membrane:.3g}, κ_b {state.fabric.bending:.3g}: {now.ending}"
        )
        return Fit(state.fabric, np.full((2, 2), np.nan), now, state.history, ending)
    if not state.history:
        state = replace(state, history=(_row(scene, now, state.fabric),))
    while not state.ending:
        if len(state.history) > iterations:
            state = replace(state, ending=f"stopped after {iterations} iterations")
            break
        on_iteration(state)
        state, now = _iterate(scene, state, now)
    return Fit(state.fabric, _covariance(scene, now), now, state.history, state.ending)


def _iterate(scene: Scene, state: Progress, now: Replay) -> tuple[Progress, Replay]:
    """One accepted Levenberg step, or the end."""
    g, A, _ = _normal_equations(scene, now)
    damping = state.damping
    for _ in range(PROPOSALS):
        step = np.clip(np.linalg.solve(A + damping * np.diag(np.diag(A)), g), -LARGEST_STEP, LARGEST_STEP)
        fabric = _moved(state.fabric, step)
        tried = replay(scene, fabric, tangents=PARAMETERS)
        if tried.complete and _loss(scene, tried) < _loss(scene, now):
            ending = "converged" if np.abs(step).max() < SETTLED else ""
            return Progress(fabric, max(damping / 10, 1e-4), (*state.history, _row(scene, tried, fabric)), ending), tried
        damping = max(damping * 20, 0.1)
    return replace(state, ending="converged: no shorter step lowers the loss"), now


def logarithms(fabric: Fabric) -> Array:
    """log κ_s and log κ_b of the fabric of density 320 kg/m³ that moves like this one [P]."""
    return np.log(np.array([fabric.membrane, fabric.bending]) * REFERENCE_DENSITY / fabric.density)


def _moved(fabric: Fabric, step: Array) -> Fabric:
    low, high = np.array([BOUNDS[name] for name in PARAMETERS]).T
    membrane, bending = np.exp(np.clip(logarithms(fabric) + step, low, high)) * fabric.density / REFERENCE_DENSITY
    return replace(fabric, membrane=float(membrane), bending=float(bending))


def _residual(scene: Scene, at: Replay) -> tuple[Array, Array]:
    """Residuals over their scale [n, 3], and Huber weights [n]. The scale is what the simulation can be blamed for at best: noise and typical misfit."""
    on = scene.compared
    r = (scene.observed - at.x)[on] / scene.noise_m[on][:, None]
    size = np.linalg.norm(r, axis=1) / np.sqrt(3)
    δ = HUBER * max(1.0, float(np.median(size)))
    return r, np.minimum(1.0, δ / np.maximum(size, 1e-12))


def _loss(scene: Scene, at: Replay) -> float:
    r, w = _residual(scene, at)
    return float(np.sum(w * np.sum(r**2, 1)) / max(len(r), 1))


def _normal_equations(scene: Scene, at: Replay) -> tuple[Array, Array, Array]:
    """Jᵀ W r [P], Jᵀ W J [P, P], and Jᵀ W r of each block of frames [block, P]."""
    on = scene.compared
    r, w = _residual(scene, at)
    J = np.stack([at.columns[n][on] / scene.noise_m[on][:, None] for n in PARAMETERS], -1)  # [n, 3, P]
    each = np.einsum("n,ncp,nc->np", w, J, r)
    block = np.nonzero(on)[0] // BLOCK
    scores = np.stack([each[block == b].sum(0) for b in np.unique(block)])
    return each.sum(0), np.einsum("n,ncp,ncq->pq", w, J, J), scores


def _covariance(scene: Scene, at: Replay) -> Array:
    g, A, scores = _normal_equations(scene, at)
    B = len(scores)
    inverse = np.linalg.pinv(A)
    spread = scores - g / B
    return inverse @ (np.einsum("bp,bq->pq", spread, spread) * B / max(B - 1, 1)) @ inverse + inverse


def _row(scene: Scene, at: Replay, fabric: Fabric) -> dict[str, float]:
    misfit = (scene.observed - at.x)[scene.compared]
    rms = float(1e3 * np.sqrt(np.mean(np.sum(misfit**2, 1))))
    return {"loss": _loss(scene, at), "rms_mm": rms, "kappa_s": fabric.membrane, "kappa_b": fabric.bending}
