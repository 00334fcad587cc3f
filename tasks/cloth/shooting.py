"""The base refit: κ_s and κ_b by Gauss–Newton over multiple-shooting windows, their start states marginalised.

    minimise over θ = (log κ_s, log κ_b)    Σ_w n_w log(r_wᵀ C_w⁻¹ r_w),    C_w = R + S_z P S_zᵀ

The logarithm is the likelihood of a window whose errors have an unknown scale: what one wild window wants does not outweigh the others. Its
Gauss–Newton step weighs window w by 1/s_w, s_w = r_wᵀC_w⁻¹r_w/n_w. The density is held: without air, motion depends on κ_s/ρ and κ_b/ρ only.
P = diag(σ_x², σ_v²) is estimated from the data by the marginal likelihood. Levenberg damping; a step is kept when it lowers the loss over the
windows that were followed before and after.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.start_state import States
from tasks.cloth.windows import Normals, Prediction, Recording, Window, columns_of, log_determinant, marginalised, normals, predict
from tasks.effects.model import Model
from tasks.simulator import Fabric

Array = NDArray[np.float64]
Map = Callable[..., Iterable]

PARAMETERS = ("log_membrane", "log_bending")
REFERENCE_DENSITY = 320.0  # [kg/m³] the bounds hold for κ · 320/ρ: they limit the ratios
BOUNDS = {"log_membrane": (np.log(0.02), np.log(200.0)), "log_bending": (np.log(0.1), np.log(500.0))}
LARGEST_STEP = 1.2  # of a logarithm
SETTLED = 0.05  # of a logarithm
PROMISE = 5e-4  # least decrease of the loss per coordinate that is worth another round
DAMPING = (1e-3, 0.5, 4.0)  # Levenberg's, relative to the diagonal; the next one after a step that failed
SCALE = 0.5  # least s_w: misfits far below the stated noise say that the noise is overstated, not that the window is right
SIGMA_X = (0.3, 1.0, 3.0)  # candidates for σ_x, of the noise
SIGMA_V = (0.01, 0.03, 0.1, 0.3, 1.0)  # candidates for σ_v [m/s]


@dataclass(frozen=True)
class Prior:
    """Standard deviations of a start state's smooth modes: σ_x [m], σ_v [m/s]."""

    x: float
    v: float

    def variances(self, names: Sequence[str]) -> Array:
        """One per state column."""
        return np.array([self.x**2 if name.startswith("x ") else self.v**2 for name in names])


@dataclass(frozen=True)
class Evidence:
    """A followed window: its prediction and its normal equations.

    The prediction keeps the columns of effects and base parameters; where the job gave a prior of the start state, what the start state
    explains has been taken out of them, and out of `residual` [L, V, 3] m (observed minus predicted, NaN where not seen).
    """

    prediction: Prediction
    normals: Normals
    residual: Array | None = None
    offset: Array | None = None


@dataclass(frozen=True)
class Job:
    """One window to follow; picklable, so that processes and workers can share the work.

    offset [L, V, 3] m: what a finer computation of the same model adds; it enters as the column "numerics".
    """

    model: Model
    recording: Recording
    window: Window
    states: States
    φ: Array
    columns: bool = False
    parameters: tuple[str, ...] = PARAMETERS
    prior: Prior | None = None
    offset: Array | None = None


def follow(job: Job) -> Evidence:
    """Simulate one window and compare it with what was observed."""
    found = predict(job.model, job.recording, job.window, job.states, parameters=job.parameters, φ=job.φ, columns=job.columns)
    if not found.complete:
        return Evidence(found, Normals((), np.zeros((0, 0)), np.zeros(0), np.nan, 0))
    if job.offset is not None:
        found.columns["numerics"] = job.offset
    free = np.ones(job.recording.observed.shape[1], bool)
    free[job.model.subject.cloth.boundary] = False
    equations = normals(found, job.recording, free)
    residual = job.recording.observed[job.window.frames][1:] - found.x[1:]
    if job.prior is not None:
        residual, found = _without_state_fields(found, equations, residual, job.prior)
    kept = {name: c for name, c in found.columns.items() if name[:2] not in ("x ", "v ")}
    return Evidence(replace(found, columns=kept), equations, residual, job.offset)


def _without_state_fields(found: Prediction, n: Normals, residual: Array, prior: Prior) -> tuple[Array, Prediction]:
    """Residual and columns less what the start state's posterior mean explains of each."""
    z = state_names(n.names)
    i, x = n.index(z), [name for name in n.names if name not in set(z)]
    H = n.G[np.ix_(i, i)] + np.diag(1 / prior.variances(z))
    weights = np.linalg.solve(H, np.column_stack([n.g[i], n.G[np.ix_(i, n.index(x))]]))
    S = np.stack([found.columns[name] for name in z], -1)
    columns = {name: found.columns[name] - S @ weights[:, k] for k, name in enumerate(x, 1)}
    return residual - S @ weights[:, 0], replace(found, columns=columns)


def state_names(names: Sequence[str]) -> list[str]:
    """Columns of the start state."""
    return [*columns_of(names, "x "), *columns_of(names, "v ")]


def without_state(normals: Normals, prior: Prior) -> Normals:
    """Normal equations with the start state marginalised."""
    z = state_names(normals.names)
    return marginalised(normals, z, prior.variances(z))


def estimated_prior(evidence: Sequence[Evidence], noise: float) -> Prior:
    """The σ_x, σ_v of highest marginal likelihood, on a grid; what the base parameters could explain is left in."""
    done = [e.normals for e in evidence if e.prediction.complete]

    def loss(prior: Prior) -> float:
        total = 0.0
        for n in done:
            z = state_names(n.names)
            total += marginalised(n, z, prior.variances(z)).c + log_determinant(n, z, prior.variances(z))
        return total

    return min((Prior(a * noise, b) for a, b in product(SIGMA_X, SIGMA_V)), key=loss)


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
    model, damping, history = jobs[0].model, DAMPING[0], []
    now = list(run(follow, jobs))
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
        step = np.linalg.solve(A + damping * np.diag(np.diag(A)), g)
        fabric, step = moved(model.subject.fabric, np.clip(step, -LARGEST_STEP, LARGEST_STEP))
        if np.abs(step).max() < SETTLED or 0.5 * full @ A @ full < PROMISE * coordinates:
            ending = "converged"
            break
        tried_model = with_fabric(model, fabric)
        tried = list(run(follow, [replace(job, model=tried_model) for job in jobs]))
        if _loss(tried, now, prior) < _loss(now, tried, prior):
            model, now, damping = tried_model, tried, DAMPING[0]
            jobs = [replace(job, model=model) for job in jobs]
            prior = estimated_prior(now, noise)
        elif damping == DAMPING[-1]:
            ending = "converged: no shorter step lowers the misfit"
            break
        else:
            damping = DAMPING[DAMPING.index(damping) + 1]
    A, _ = summed(weighed(now, prior), PARAMETERS)
    return BaseFit(model, np.linalg.pinv(A), prior, tuple(now), tuple(history), ending)


def weighed(evidence: Sequence[Evidence], prior: Prior) -> list[Normals]:
    """Normal equations of the windows that were followed, the start state marginalised, each over its own scale s_w."""
    found = [without_state(e.normals, prior) for e in evidence if e.prediction.complete]
    scale = [max(n.c / n.n, SCALE) for n in found]
    return [replace(n, G=n.G / s, g=n.g / s, c=n.c / s) for n, s in zip(found, scale, strict=True)]


def summed(normals: Sequence[Normals], names: Sequence[str]) -> tuple[Array, Array]:
    """Σ G [P, P] and Σ g [P] over windows, for these columns."""
    A, g = np.zeros((len(names), len(names))), np.zeros(len(names))
    for n in normals:
        i = n.index(names)
        A += n.G[np.ix_(i, i)]
        g += n.g[i]
    return A, g


def moved(fabric: Fabric, step: Array) -> tuple[Fabric, Array]:
    """The fabric after a step of the logarithms, within bounds, and the step that was possible."""
    low, high = np.array([BOUNDS[name] for name in PARAMETERS]).T
    now = np.log(np.array([fabric.membrane, fabric.bending]) * REFERENCE_DENSITY / fabric.density)
    then = np.clip(now + step, low, high)
    membrane, bending = np.exp(then) * fabric.density / REFERENCE_DENSITY
    return replace(fabric, membrane=float(membrane), bending=float(bending)), then - now


def with_fabric(model: Model, fabric: Fabric) -> Model:
    """The model with another fabric."""
    return replace(model, subject=replace(model.subject, fabric=fabric))


def _loss(of: Sequence[Evidence], beside: Sequence[Evidence], prior: Prior) -> float:
    """Σ n log s over the windows that both sets could follow; windows lost count as failure."""
    both = [e.prediction.complete and b.prediction.complete for e, b in zip(of, beside, strict=True)]
    if not any(both) or sum(e.prediction.complete for e in of) < sum(b.prediction.complete for b in beside):
        return np.inf
    found = [without_state(e.normals, prior) for e, ok in zip(of, both, strict=True) if ok]
    return sum(n.n * float(np.log(max(n.c / n.n, SCALE))) for n in found)


def _row(fabric: Fabric, now: Sequence[Evidence], prior: Prior) -> dict[str, float]:
    done = [e.normals for e in now if e.prediction.complete]
    n = max(sum(d.n for d in done), 1)
    misfit = sum(without_state(d, prior).c for d in done) / n
    return {
        "kappa_s": fabric.membrane,
        "kappa_b": fabric.bending,
        "misfit": misfit,
        "windows": len(done),
        "sigma_x": prior.x,
        "sigma_v": prior.v,
    }
