"""The base refit: κ_s and κ_b by Gauss–Newton over multiple-shooting windows, their start states marginalised.

    minimise over θ = (log κ_s, log κ_b)    Σ_w n_w log(r_wᵀ C_w⁻¹ r_w),    C_w = R + S_z P S_zᵀ

The logarithm is the likelihood of a window whose errors have an unknown scale: what one wild window wants does not outweigh the others. Its
Gauss–Newton step weighs window w by 1/s_w, s_w = r_wᵀC_w⁻¹r_w/n_w. The density is held: without air, motion depends on κ_s/ρ and κ_b/ρ
only. P = diag(σ_x², σ_v²) and the correlation in R are those of highest marginal likelihood, Σ_w r_wᵀC_w⁻¹r_w + log|C_w|. Levenberg
damping; a step is kept when it loses no window and lowers the loss over those that were followed before it. Where the slope that a step met
fell by less than JᵀJ promised, the next one is longer by that ratio (the secant equation of Dennis & Moré 1977 along the step).

Nameless forcing has no part in the refit: it would take for itself what stiffness explains. It enters, with σ_a in P, where causes are
weighed (`Job.forced`).
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.start_state import States
from tasks.cloth.state_modes import state_columns
from tasks.cloth.tracking_noise import IN_ONE_FRAME, Correlation
from tasks.cloth.windows import Normals, Prediction, Recording, Window, columns_of, marginalised, normals, predict
from tasks.effects.model import Model
from tasks.simulator import Fabric

Array = NDArray[np.float64]
Map = Callable[..., Iterable]
Start = Mapping[str, float]
NUISANCES = ("x ", "v ", "a ")  # how names of columns begin that are marginalised: start state and forcing

PARAMETERS = ("log_membrane", "log_bending")
REFERENCE_DENSITY = 320.0  # [kg/m³] the bounds hold for κ · 320/ρ: they limit the ratios
BOUNDS = {"log_membrane": (np.log(0.02), np.log(200.0)), "log_bending": (np.log(0.1), np.log(500.0))}
LARGEST_STEP = 1.2  # of a logarithm
LONGEST = 4.0  # times Gauss–Newton's own step, where the last one showed less curvature than promised
SETTLED = 0.05  # of a logarithm
PROMISE = 5e-4  # least decrease of the loss per coordinate that is worth another round
STUCK = "stopped: no shorter step lowers the misfit; another start may end elsewhere"
DAMPING = (1e-3, 0.5, 4.0)  # Levenberg's, relative to the diagonal; the next one after a step that failed
CORRECTED = (1.0, 0.5)  # shares of a start's correction that are tried
PER_FRAME = 0.5  # of the noise, by which a start's velocity may be off
SCALE = 0.5  # least s_w: misfits far below the stated noise say that the noise is overstated, not that the window is right
SIGMA_X = (0.1, 0.3, 1.0, 3.0)  # candidates for σ_x, of the noise,
SIGMA_V = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)  # for σ_v [m/s],
SIGMA_A = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0)  # and for σ_a [m/s²]


@dataclass(frozen=True)
class Prior:
    """Standard deviations of smooth modes: σ_x [m] and σ_v [m/s] of a start state; σ_a [m/s²] of the forcing."""

    x: float
    v: float
    a: float = 0.0

    def variances(self, names: Sequence[str]) -> Array:
        """One per state column."""
        return np.array([self.x**2 if name.startswith("x ") else self.v**2 for name in names])


@dataclass(frozen=True)
class Evidence:
    """A followed window: its prediction and its normal equations.

    The prediction keeps the columns of effects and base parameters; where the job gave a prior, what the start state explains has been
    taken out of them, and out of `residual` [L, V, 3] m (observed minus predicted, NaN where not seen). start: where derivatives were taken
    (`Job.start`).
    """

    prediction: Prediction
    normals: Normals
    residual: Array | None = None
    offsets: Mapping[str, Array] = field(default_factory=dict)
    start: Start = field(default_factory=dict)


@dataclass(frozen=True)
class Job:
    """One window to follow; picklable, so that processes and workers can share the work.

    columns: derivatives by all effects of the model; forced: and by the forcing. offsets: name -> [L, V, 3] m, what computing the same
    model otherwise changes (`numerics.py`): further columns. start: coefficients of the start state's modes with which the window is
    simulated, so that derivatives are taken nearer to what was seen; what is told is told about `states` all the same: x(z) − S z (the
    iterated Kalman filter's form, Jazwinski 1970, § 8.3).
    """

    model: Model
    recording: Recording
    window: Window
    states: States
    φ: Array
    columns: bool = False
    forced: bool = False
    parameters: tuple[str, ...] = PARAMETERS
    prior: Prior | None = None
    offsets: Mapping[str, Array] = field(default_factory=dict)
    start: Start = field(default_factory=dict)

    @property
    def started(self) -> States:
        """The states, that of the window's start moved by `start`."""
        if not self.start:
            return self.states
        x, v, modes, t = self.states.x.copy(), self.states.v.copy(), state_columns(self.φ), self.window.start
        for name, z in self.start.items():
            x[t] += z * modes[name][0]
            v[t] += z * modes[name][1]
        return replace(self.states, x=x, v=v)


def follow(job: Job) -> Evidence:
    """Simulate one window and compare it with what was observed; from the state itself where it cannot be followed from `job.start`."""
    found = predict(
        job.model, job.recording, job.window, job.started, parameters=job.parameters, φ=job.φ, columns=job.columns, forced=job.forced
    )
    if not found.complete:
        return follow(replace(job, start={})) if job.start else Evidence(found, Normals((), np.zeros((0, 0)), np.zeros(0), np.nan, 0))
    for name, z in job.start.items():
        found.x[1:] -= z * found.columns[name]
    found.columns.update(job.offsets)
    equations = normals(found, job.recording, job.model.subject)
    residual = job.recording.observed[job.window.frames][1:] - found.x[1:]
    if job.prior is not None:
        residual, found = _without_state_fields(found, equations, residual, job.prior)
    kept = {name: c for name, c in found.columns.items() if name[:2] not in NUISANCES}
    return Evidence(replace(found, columns=kept), equations, residual, job.offsets, job.start)


def follow_corrected(job: Job) -> Evidence:
    """The window simulated again from the start that its derivatives ask for, twice; `residual` is of the last one.

    Where no start along them is nearer the first stands, uncorrected.
    """
    first = follow(job)
    if not first.prediction.complete:
        return first
    start, x = nearer_start(job, first, first.prediction.x)
    if start:
        nearer = replace(job, start=start)
        _, x = nearer_start(nearer, follow(nearer), x)
    return replace(first, residual=job.recording.observed[job.window.frames][1:] - x[1:])


def likely_start(job: Job) -> Prior:
    """How far off a start can be: places by the noise, velocities by half of it in a frame, for states are smoothed from places so noisy.

    The prior of the marginal likelihood is wider, by up to 20 times: it has to hold what the model errs by as well. Simulated from where
    that one leads, cloth goes elsewhere altogether.
    """
    noise = float(np.median(job.recording.noise))
    return Prior(noise, PER_FRAME * noise * job.model.subject.fps)


def nearer_start(job: Job, found: Evidence, x: Array) -> tuple[Start, Array]:
    """The start state that the derivatives of a followed window ask for, if `likely_start` says how far off it was, and the window
    simulated from there, [L + 1, V, 3] m.

    Derivatives do not know that contact stops cloth: a start corrected along them may lie where no cloth can be, and is freed of the body.
    Where the simulation fails or comes no nearer than x [L + 1, V, 3] m, simulated from `job.start`, half the correction is tried; then
    both stay as they are.
    """
    names = state_names(found.normals.names)
    asked = state_weights(found.normals, names, [], likely_start(job).variances(names))[:, 0]
    return first_nearer(job, dict(zip(names, asked, strict=True)), x)


def first_nearer(job: Job, asked: Start, x: Array) -> tuple[Start, Array]:
    """The start asked for, or half-way to it, and the window simulated from there; `job.start` and x [L + 1, V, 3] m where neither comes nearer than x."""
    observed, now = job.recording.observed[job.window.frames][1:], {name: job.start.get(name, 0.0) for name in asked}
    for share in CORRECTED:
        tried = replace(job, start={name: now[name] + share * (z - now[name]) for name, z in asked.items()})
        again = predict(job.model, job.recording, job.window, tried.started)
        if again.complete and np.nansum((observed - again.x[1:]) ** 2) < np.nansum((observed - x[1:]) ** 2):
            return tried.start, again.x
    return job.start, x


def _without_state_fields(found: Prediction, n: Normals, residual: Array, prior: Prior) -> tuple[Array, Prediction]:
    """Residual and columns less what the start state's posterior mean explains of each."""
    z, x = state_names(n.names), [name for name in n.names if name[:2] not in NUISANCES]
    weights = state_weights(n, z, x, prior.variances(z))
    S = np.stack([found.columns[name] for name in z], -1)
    columns = {name: found.columns[name] - S @ weights[:, k] for k, name in enumerate(x, 1)}
    return residual - S @ weights[:, 0], replace(found, columns=columns)


def state_weights(n: Normals, z: Sequence[str], columns: Sequence[str], variances: Array) -> Array:
    """Posterior mean [Z, 1 + C] of the start state's coefficients z, of variances [Z] before, that explains the residual, and each of the columns."""
    i = n.index(z)
    H = n.G[np.ix_(i, i)] + np.diag(1 / variances)
    return np.linalg.solve(H, np.column_stack([n.g[i], n.G[np.ix_(i, n.index(columns))]]))


def state_names(names: Sequence[str]) -> list[str]:
    """Columns of the start state."""
    return [*columns_of(names, "x "), *columns_of(names, "v ")]


def without_nuisances(normals: Normals, prior: Prior) -> Normals:
    """Normal equations with start state and forcing marginalised."""
    return without_forcing(without_state(normals, prior), prior.a)


def without_forcing(normals: Normals, σ_a: float) -> Normals:
    """Normal equations with a forcing of size σ_a [m/s²] marginalised; as they are where there is none."""
    a = list(columns_of(normals.names, "a "))
    return marginalised(normals, a, np.full(len(a), σ_a**2)) if a else normals


def without_state(normals: Normals, prior: Prior) -> Normals:
    """Normal equations with the start state marginalised; the forcing keeps its columns."""
    z = state_names(normals.names)
    return marginalised(normals, z, prior.variances(z))


def estimated_prior(evidence: Sequence[Evidence], noise: float, near: Prior | None = None) -> Prior:
    """The σ_x, σ_v, and σ_a where there is forcing, of highest marginal likelihood on a grid, one after the other, from those `near`; what
    base parameters could explain is left in. Forcing has the first say: a wide prior of the start would take for error what pushes the
    cloth.
    """
    done = [e.normals for e in evidence if e.prediction.complete]
    forced = any(name.startswith("a ") for n in done[:1] for name in n.names)
    candidates = {"a": SIGMA_A if forced else (0.0,), "x": [s * noise for s in SIGMA_X], "v": SIGMA_V}
    prior = near or (Prior(candidates["x"][0], SIGMA_V[0]) if forced else Prior(noise, 0.1))
    for _ in range(1 if near else 2):
        for name, values in candidates.items():
            close = [v for v in values if near is None or _neighbours(values, getattr(near, name), v)]
            prior = min((replace(prior, **{name: v}) for v in close), key=lambda p: minus_log_likelihood(done, p))
    return prior


def _neighbours(grid: Sequence[float], a: float, b: float) -> bool:
    return abs(int(np.argmin(np.abs(np.subtract(grid, a)))) - int(np.argmin(np.abs(np.subtract(grid, b))))) <= 1


def minus_log_likelihood(normals: Sequence[Normals], prior: Prior) -> float:
    """Σ_w r_wᵀC_w⁻¹r_w + log|C_w|."""
    each = [without_nuisances(n, prior) for n in normals]
    return sum(n.c + n.logdet for n in each)


def estimated_correlation(jobs: Sequence[Job], prior: Prior, noise: float, run: Map = map) -> Correlation:
    """The correlation of the tracker's errors of highest marginal likelihood, over a few windows: what neighbours share, then how long it
    lasts. σ_x and σ_a, which would take shared errors for motion, are chosen along with it.
    """
    in_one = _likeliest(IN_ONE_FRAME, jobs, prior, noise, run)
    return _likeliest(in_one.lasting(), jobs, prior, noise, run) if in_one.share else in_one


def _likeliest(candidates: Sequence[Correlation], jobs: Sequence[Job], prior: Prior, noise: float, run: Map) -> Correlation:
    each = [losses for losses in run(_losses, [(job, prior, noise, candidates) for job in jobs]) if losses is not None]
    return candidates[int(np.argmin(np.sum(each, 0).min(1)))] if each else candidates[0]


def _losses(job: tuple[Job, Prior, float, Sequence[Correlation]]) -> Array | None:
    """−2 log likelihood of a window [candidate, σ_x and σ_a]."""
    todo, prior, noise, candidates = job
    found = predict(todo.model, todo.recording, todo.window, todo.states, parameters=(), φ=todo.φ, forced=True)
    if not found.complete:
        return None
    each = [normals(found, replace(todo.recording, correlation=c), todo.model.subject) for c in candidates]
    freed = [[without_state(n, replace(prior, x=s * noise)) for s in SIGMA_X] for n in each]
    pushed = [[without_forcing(n, a) for n, a in product(of, SIGMA_A[::2])] for of in freed]
    return np.array([[n.c + n.logdet for n in of] for of in pushed])


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
        step = stretch * np.linalg.solve(A + damping * np.diag(np.diag(A)), g)
        fabric, step = moved(model.subject.fabric, np.clip(step, -LARGEST_STEP, LARGEST_STEP))
        if np.abs(step).max() < SETTLED or 0.5 * stretch * full @ A @ full < PROMISE * coordinates:
            ending = "converged" if damping == DAMPING[0] else STUCK
            break
        tried_model = with_fabric(model, fabric)
        tried = list(run(follow, [replace(job, model=tried_model) for job in jobs]))
        if gain(now, tried, partial(_loss, prior=prior)) > 0:
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


def gain(now: Sequence[Evidence], tried: Sequence[Evidence], loss: Callable[[Evidence], float]) -> float:
    """By how much a step lowers Σ loss over the windows that were followed before it; −∞ where it loses one of them.

    Windows that it regains have no loss to be compared with: they count from the next step on.
    """
    both = [(before, then) for before, then in zip(now, tried, strict=True) if before.prediction.complete]
    if not both or not all(then.prediction.complete for _, then in both):
        return -np.inf
    return sum(loss(before) - loss(then) for before, then in both)


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


def _loss(of: Evidence, prior: Prior) -> float:
    return unscaled_loss(without_nuisances(of.normals, prior))


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
