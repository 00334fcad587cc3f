"""The base refit: κ_s and κ_b by Gauss–Newton over multiple-shooting windows, their start states marginalised.

    minimise over θ = (log κ_s, log κ_b)    Σ_w n_w log(r_wᵀ C_w⁻¹ r_w),    C_w = R + S_z P S_zᵀ

The logarithm is the likelihood of a window whose errors have an unknown scale: what one wild window wants does not outweigh the others. Its
Gauss–Newton step weighs window w by 1/s_w, s_w = r_wᵀC_w⁻¹r_w/n_w. Levenberg damping; a step is kept when it loses no window and lowers the
loss over those that were followed before it. Where the slope that a step met fell by less than JᵀJ promised, the next one is longer by that
ratio (the secant equation of Dennis & Moré 1977 along the step).

What is compared is x(θ) + S(θ) z, what is differentiated x(θ): about the start as tracked, whose answer z is large, slopes may have the
wrong sign. So windows are simulated, and differentiated, from the starts that they ask for with the first fabric.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.base_parameters import PARAMETERS, moved, with_fabric
from tasks.cloth.likeliest_errors import estimated_prior
from tasks.cloth.nuisances import Prior, without_nuisances
from tasks.cloth.shooting import Evidence, Job, Map, about_nearer_start, follow
from tasks.cloth.windows import Normals
from tasks.effects.model import Model
from tasks.simulator import Fabric

Array = NDArray[np.float64]
LARGEST_STEP = 1.2  # of a logarithm
LONGEST = 4.0  # times Gauss–Newton's own step, where the last one showed less curvature than promised
SETTLED = 0.05  # of a logarithm
PROMISE = 5e-4  # least decrease of the loss per coordinate that is worth another round
STUCK = "stopped: no shorter step lowers the misfit; another start may end elsewhere"
DAMPING = (1e-3, 0.5, 4.0)  # Levenberg's, relative to the diagonal; the next one after a step that failed
SCALE = 0.5  # least s_w: misfits far below the stated noise say that the noise is overstated, not that the window is right


@dataclass(frozen=True)
class BaseFit:
    """The refitted model, covariance [2, 2] of the logarithms, the start states' prior, what every window then says, misfits per iteration."""

    model: Model
    covariance: Array
    prior: Prior
    evidence: tuple[Evidence, ...]
    history: tuple[dict[str, float], ...]
    ending: str


def refit(
    jobs: Sequence[Job], *, noise: float, iterations: int = 4, run: Map = map, tell: Callable[[str], None] = lambda text: None
) -> BaseFit:
    """Fit `PARAMETERS` from the model of the jobs, all of one model."""
    model, damping, stretch, history = jobs[0].model, DAMPING[0], 1.0, []
    jobs, now = about_nearer_starts(jobs, list(run(follow, jobs)), run)
    prior = estimated_prior(now, noise)
    ending = f"stopped after {iterations} iterations"
    for _ in range(iterations):
        A, g = summed(weighed(now, prior), PARAMETERS)
        history.append(_row(model.subject.fabric, now, prior))
        tell(f"κ_s {model.subject.fabric.membrane:.3g}, κ_b {model.subject.fabric.bending:.3g}: misfit {history[-1]['misfit']:.3g}")
        if not A.any():
            ending = "no window can be followed"
            break
        full = np.linalg.solve(A + 1e-9 * np.trace(A) * np.eye(2), g)
        coordinates = sum(e.normals.n for e in now)
        step = stretch * np.linalg.solve(A + damping * np.diag(np.diag(A)), g)
        fabric, step = moved(model.subject.fabric, np.clip(step, -LARGEST_STEP, LARGEST_STEP))
        if np.abs(step).max() < SETTLED or 0.5 * stretch * full @ A @ full < PROMISE * coordinates:
            ending = "converged" if damping == DAMPING[0] else STUCK
            break
        tried_model = with_fabric(model, fabric)
        tried = list(run(follow, [replace(job, model=tried_model) for job in jobs]))
        if nearer_by(now, tried, prior) > 0:
            met = [then for before, then in zip(now, tried, strict=True) if before.prediction.complete]
            stretch = stretch_of(A, g, summed(weighed(met, prior), PARAMETERS)[1], step)
            model, now, damping = tried_model, tried, DAMPING[0]
            jobs = [replace(job, model=model) for job in jobs]
            prior = estimated_prior(now, noise, prior)
        elif stretch > 1:
            stretch = 1.0
        elif damping == DAMPING[-1]:
            ending = STUCK
            break
        else:
            damping = DAMPING[DAMPING.index(damping) + 1]
    A, _ = summed(weighed(now, prior), PARAMETERS)
    return BaseFit(model, np.linalg.pinv(A), prior, tuple(now), tuple(history), ending)


def about_nearer_starts(jobs: Sequence[Job], found: Sequence[Evidence], run: Map = map) -> tuple[list[Job], list[Evidence]]:
    """The jobs with the starts that their windows ask for, and the windows followed about these."""
    nearer = list(run(about_nearer_start, list(zip(jobs, found, strict=True))))
    return [replace(job, start=evidence.start) for job, evidence in zip(jobs, nearer, strict=True)], nearer


def gain(now: Sequence[Evidence], tried: Sequence[Evidence], loss: Callable[[Evidence], float]) -> float:
    """By how much a step lowers Σ loss over the windows that were followed before it; −∞ where it loses one of them.

    Windows that it regains have no loss to be compared with: they count from the next step on.
    """
    both = [(before, then) for before, then in zip(now, tried, strict=True) if before.prediction.complete]
    if not both or not all(then.prediction.complete for _, then in both):
        return -np.inf
    return sum(loss(before) - loss(then) for before, then in both)


def nearer_by(now: Sequence[Evidence], tried: Sequence[Evidence], prior: Prior) -> float:
    """The same of the base's own loss, start states and forcing marginalised."""
    return gain(now, tried, lambda e: unscaled_loss(without_nuisances(e.normals, prior)))


def stretch_of(A: Array, g: Array, after: Array, step: Array) -> float:
    """By how much the next Gauss–Newton step is too short: curvature JᵀJ that was promised along a step [P] over what the gradients g,
    after [P] met.

    Where the start states are wrong in ways that no mode holds, their part of J adds to JᵀJ but leads nowhere, and steps creep; so they do
    where the slope grows on the way, as that of ln κ_b does in cloth taken far too soft.
    """
    met = float(step @ (g - after))
    return float(np.clip(step @ A @ step / met, 1.0, LONGEST)) if met > 0 else LONGEST


def weighed(evidence: Sequence[Evidence], prior: Prior) -> list[Normals]:
    """Normal equations of the windows that were followed, start state and forcing marginalised, each over its own scale s_w."""
    return [scaled(without_nuisances(e.normals, prior)) for e in evidence if e.prediction.complete]


def scale(n: Normals) -> float:
    """s_w of a window."""
    return max(n.c / n.n, SCALE)


def unscaled_loss(n: Normals) -> float:
    """n log s_w: −2 log likelihood of a window whose scale nobody knows."""
    return n.n * float(np.log(scale(n)))


def scaled(n: Normals) -> Normals:
    """Normal equations of a window over its own scale s_w."""
    s = scale(n)
    return replace(n, G=n.G / s, g=n.g / s, c=n.c / s)


def summed(normals: Sequence[Normals], names: Sequence[str]) -> tuple[Array, Array]:
    """Σ G [P, P] and Σ g [P] over windows, for these columns."""
    A, g = np.zeros((len(names), len(names))), np.zeros(len(names))
    for n in normals:
        i = n.index(names)
        A += n.G[np.ix_(i, i)]
        g += n.g[i]
    return A, g


def _row(fabric: Fabric, now: Sequence[Evidence], prior: Prior) -> dict[str, float]:
    done = [e.normals for e in now if e.prediction.complete]
    n = max(sum(d.n for d in done), 1)
    misfit = sum(without_nuisances(d, prior).c for d in done) / n
    return {
        "kappa_s": fabric.membrane,
        "kappa_b": fabric.bending,
        "misfit": misfit,
        "windows": len(done),
        "sigma_x": prior.x,
        "sigma_v": prior.v,
    }
