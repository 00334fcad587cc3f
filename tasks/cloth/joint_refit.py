"""The refit of a base model to which effects were added: κ_s, κ_b and all strengths together, by Gauss–Newton over multiple-shooting
windows.

    minimise over θ = (log κ_s, log κ_b, strengths/typical)    Σ_w n_w log(r_wᵀ C_w⁻¹ r_w) + Σ_strengths (θ/3)²

with r_w, C_w as in `base_refit.py` and what a finer computation adds (`numerics.py`) taken off. It begins where the base model alone ended,
at strength zero: there part of what the effects do was laid to the fabric, and both are corrected together. Every step solves the quadratic
problem within the bounds of the fabric and the plausible ranges of the strengths; the weak prior decides only between effects that the
recording cannot tell apart.

Source: Coleman & Li 1996 (the bounded step, as in scipy's lsq_linear); Nocedal & Wright 2006, ch. 10 (Levenberg damping).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from tasks.cloth.base_parameters import BOUNDS, PARAMETERS, logarithms, moved, with_fabric
from tasks.cloth.base_refit import DAMPING, STUCK, BaseFit, about_nearer_starts, gain, scaled, unscaled_loss
from tasks.cloth.gauss_newton import LARGEST_STEP, Fit, Normal
from tasks.cloth.likeliest_errors import estimated_prior
from tasks.cloth.nuisances import Prior, without_state
from tasks.cloth.numerics import WAYS, common_error, corrected
from tasks.cloth.shooting import Evidence, Job, Map, follow
from tasks.cloth.windows import Normals
from tasks.effects.effect import Effect
from tasks.effects.model import Model

Array = NDArray[np.float64]

RIDGE = 3.0  # prior standard deviation of a strength, in typical strengths
UNFOLLOWED = "stopped: no window can be followed from there"
SETTLED = 0.03  # of a logarithm, or of a typical strength


@dataclass(frozen=True)
class Completed:
    """The completed model, what every window then says, the start states' prior, misfits per iteration, and how it ended."""

    model: Model
    evidence: tuple[Evidence, ...]
    prior: Prior
    history: tuple[dict[str, float], ...]
    ending: str


@dataclass(frozen=True)
class CompletedFit(Fit):
    """A fit whose model has effects beside the base. Its normal equations hold κ_s, κ_b and every strength in typical strengths."""

    model: Model | None = None


def refit_jointly(
    base: BaseFit,
    jobs: Sequence[Job],
    effects: Sequence[Effect],
    *,
    noise: float,
    iterations: int,
    run: Map = map,
    tell: Callable[[str], None] = lambda text: None,
) -> Completed:
    """From the refitted base, on the windows it could follow (`jobs`), with at most `iterations` accepted steps; noise [m] per coordinate.

    Strengths begin at those that the base's model has, zero by default, and stay there where no window can be followed.
    """
    model = replace(base.model, effects=tuple(effects), strengths={e.name: base.model.strength(e) for e in effects})
    jobs = [replace(job, model=model, columns=True) for job in jobs]
    jobs, now = about_nearer_starts(jobs, _followed(model, jobs, run), run)
    prior, ending = estimated_prior(now, noise), f"stopped after {iterations} iterations"
    history = [_row(model, now, prior)]
    if not any(e.prediction.complete for e in now):
        return Completed(model, tuple(now), prior, tuple(history), UNFOLLOWED)
    for _ in range(iterations):
        if np.abs(_step(model, now, prior, DAMPING[0])).max() < SETTLED:
            ending = "converged"
            break
        better = _better(model, now, jobs, prior, run)
        if better is None:
            ending = STUCK
            break
        model, now = better
        prior = estimated_prior(now, noise, prior)
        history.append(_row(model, now, prior))
        tell(f"{_strengths_told(model)}: misfit {history[-1]['misfit']:.3g}")
    return Completed(model, tuple(now), prior, tuple(history), ending)


def joint_normal(model: Model, evidence: Sequence[Evidence], prior: Prior) -> Normal:
    """Normal equations per window in θ, each over its own scale; NaN where no window can be followed."""
    P = len(_vector(model))
    found = _weighed(model, evidence, prior)
    if not found:
        return Normal(np.full((1, P), np.nan), np.full((1, P, P), np.nan))
    whole = [_with_numerics(model, e, prior) for e in evidence if e.prediction.complete]
    return Normal(np.stack([n.g for n in found]), np.stack([n.G for n in found]), common_error(whole, found[0].names))


def moved_jointly(model: Model, step: Array) -> Model:
    """The model after a step of θ [2 + K], the fabric within its bounds."""
    fabric, _ = moved(model.subject.fabric, step[: len(PARAMETERS)])
    at, strengths = len(PARAMETERS), {}
    for effect in model.effects:
        K = len(effect.strengths)
        strengths[effect.name] = model.strength(effect) + step[at : at + K] * np.abs(effect.typical)
        at += K
    return replace(with_fabric(model, fabric), strengths=strengths)


def _better(model: Model, now: Sequence[Evidence], jobs: Sequence[Job], prior: Prior, run: Map) -> tuple[Model, Sequence[Evidence]] | None:
    """The model after the first step, each shorter than the last, that loses no window and lowers the loss, and its windows; None where none does."""
    for damping in DAMPING:
        tried = moved_jointly(model, _step(model, now, prior, damping))
        evidence = _followed(tried, jobs, run)
        nearer = _ridge(model) - _ridge(tried)
        if gain(now, evidence, lambda e: unscaled_loss(_told(model, e, prior))) + nearer > 0:
            return tried, evidence
    return None


def _followed(model: Model, jobs: Sequence[Job], run: Map) -> list[Evidence]:
    return list(run(follow, [replace(job, model=model) for job in jobs]))


def _step(model: Model, now: Sequence[Evidence], prior: Prior, damping: float) -> Array:
    """argmin ½ pᵀHp − bᵀp within all bounds, H damped."""
    found, θ = _weighed(model, now, prior), _vector(model)
    precision = np.where(np.arange(len(θ)) < len(PARAMETERS), 0.0, RIDGE**-2)
    H = sum(n.G for n in found) + np.diag(precision)
    b = sum(n.g for n in found) - precision * θ
    L = np.linalg.cholesky(H + np.diag(damping * np.diag(H) + 1e-9 * np.trace(H)))
    low, high = _bounds(model)
    low, high = np.clip(low - θ, -LARGEST_STEP, 0), np.clip(high - θ, 0, LARGEST_STEP)
    return lsq_linear(L.T, np.linalg.solve(L, b), bounds=(low - 1e-12, high + 1e-12)).x


def _vector(model: Model) -> Array:
    """θ [2 + K] of a model."""
    return np.concatenate([logarithms(model.subject.fabric), *(model.strength(e) / np.abs(e.typical) for e in model.effects)])


def _bounds(model: Model) -> tuple[Array, Array]:
    strengths = [s for e in model.effects for s in e.strengths]
    low = [BOUNDS[name][0] for name in PARAMETERS] + [s.low / abs(s.typical) for s in strengths]
    high = [BOUNDS[name][1] for name in PARAMETERS] + [s.high / abs(s.typical) for s in strengths]
    return np.array(low), np.array(high)


def _told(model: Model, evidence: Evidence, prior: Prior) -> Normals:
    """Normal equations of one window in θ, start state and numerics integrated out."""
    return corrected(_with_numerics(model, evidence, prior))


def _with_numerics(model: Model, evidence: Evidence, prior: Prior) -> Normals:
    """The same in θ and the coefficients of numerics."""
    n = without_state(evidence.normals, prior)
    columns = [(c, abs(s.typical)) for e in model.effects for c, s in zip(e.columns, e.strengths, strict=True)]
    ways = [name for name in n.names if name in WAYS]
    names = (*PARAMETERS, *(c for c, _ in columns), *ways)
    unit = np.array([1.0] * len(PARAMETERS) + [typical for _, typical in columns] + [1.0] * len(ways))
    i = n.index(names)
    return Normals(names, n.G[np.ix_(i, i)] * np.outer(unit, unit), n.g[i] * unit, n.c, n.n)


def _weighed(model: Model, evidence: Sequence[Evidence], prior: Prior) -> list[Normals]:
    return [scaled(_told(model, e, prior)) for e in evidence if e.prediction.complete]


def _ridge(model: Model) -> float:
    """Σ_strengths (θ/3)²."""
    return float(np.sum((_vector(model)[len(PARAMETERS) :] / RIDGE) ** 2))


def _row(model: Model, now: Sequence[Evidence], prior: Prior) -> dict[str, float]:
    found = [_told(model, e, prior) for e in now if e.prediction.complete]
    strengths = model.by_column(model.effects)
    fabric = model.subject.fabric
    misfit = sum(n.c for n in found) / max(sum(n.n for n in found), 1)
    return {"kappa_s": fabric.membrane, "kappa_b": fabric.bending, **strengths, "misfit": misfit, "windows": len(found)}


def _strengths_told(model: Model) -> str:
    return ", ".join(f"{c} {v:.3g}" for c, v in model.by_column(model.effects).items())
