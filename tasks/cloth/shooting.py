"""Multiple shooting: each window is simulated from a start state of its own and compared with what was observed.

Source: as `windows.py`. The start state is not fitted but marginalised (`nuisances.py`).
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.nuisances import NUISANCES, Prior, state_names, state_weights
from tasks.cloth.start_errors import start_variances
from tasks.cloth.start_state import States
from tasks.cloth.state_modes import state_columns
from tasks.cloth.windows import Normals, Prediction, Recording, Window, normals, predict
from tasks.effects.model import Model

Array = NDArray[np.float64]
Map = Callable[..., Iterable]
Start = Mapping[str, float]
CORRECTED = (1.0, 0.5)  # shares of a start's correction that are tried


@dataclass(frozen=True)
class Evidence:
    """A followed window: its prediction and its normal equations.

    The prediction keeps the columns of effects and base parameters; where the job gave a prior, what the start state explains has been
    taken out of them, and out of `residual` [L, V, 3] m (observed minus predicted, NaN where not seen). start: where derivatives were taken
    (`Job.start`); simulated [L + 1, V, 3] m: from there.
    """

    prediction: Prediction
    normals: Normals
    residual: Array | None = None
    offsets: Mapping[str, Array] = field(default_factory=dict)
    start: Start = field(default_factory=dict)
    simulated: Array | None = None


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
    simulated = found.x.copy()
    for name, z in job.start.items():
        found.x[1:] -= z * found.columns[name]
    found.columns.update(job.offsets)
    equations = normals(found, job.recording, job.model.subject)
    residual = job.recording.observed[job.window.frames][1:] - found.x[1:]
    if job.prior is not None:
        residual, found = _without_state_fields(found, equations, residual, job.prior)
    kept = {name: c for name, c in found.columns.items() if name[:2] not in NUISANCES}
    return Evidence(replace(found, columns=kept), equations, residual, job.offsets, job.start, simulated)


def follow_nearer(job: Job) -> Evidence:
    """The window followed with its derivatives taken about the start that they ask for (`nearer_start`), whatever `job.start` is."""
    plain = replace(job, columns=False, forced=False, offsets={}, start={})
    found = follow(plain)
    start = nearer_start(plain, found)[0] if found.prediction.complete else {}
    return follow(replace(job, start=start))


def follow_corrected(job: Job) -> Evidence:
    """The window simulated again from the start that its derivatives ask for, twice; `residual` is of the last one.

    Where no start along them is nearer the first stands, uncorrected.
    """
    first = follow(job)
    if not first.prediction.complete:
        return first
    start, x = nearer_start(job, first)
    if start:
        nearer = replace(job, start=start)
        _, x = nearer_start(nearer, follow(nearer))
    return replace(first, residual=job.recording.observed[job.window.frames][1:] - x[1:])


def nearer_start(job: Job, found: Evidence) -> tuple[Start, Array]:
    """The start state that the derivatives of a followed window ask for, if errors of tracking say how far off it was
    (`start_errors.py`), and the window simulated from there, [L + 1, V, 3] m.

    Derivatives do not know that contact stops cloth: a start corrected along them may lie where no cloth can be, and is freed of the body.
    Where the simulation fails or comes no nearer than that from `job.start`, half the correction is tried; then both stay as they are.
    """
    return first_nearer(job, _asked(job, found), found.simulated)


def about_nearer_start(followed: tuple[Job, Evidence]) -> Evidence:
    """The window followed about the start that its derivatives ask for, or half-way to it; as it was where neither comes nearer."""
    job, found = followed
    if found.prediction.complete:
        for start in _towards(job, _asked(job, found)):
            again = follow(replace(job, start=start))
            if again.start and _comes_nearer(job, again.simulated, found.simulated):
                return again
    return found


def first_nearer(job: Job, asked: Start, x: Array) -> tuple[Start, Array]:
    """The start asked for, or half-way to it, and the window simulated from there; `job.start` and x [L + 1, V, 3] m where neither comes nearer than x."""
    for start in _towards(job, asked):
        again = predict(job.model, job.recording, job.window, replace(job, start=start).started)
        if again.complete and _comes_nearer(job, again.x, x):
            return start, again.x
    return job.start, x


def _asked(job: Job, found: Evidence) -> Start:
    names = state_names(found.normals.names)
    variances = start_variances(job.recording, job.model.subject, job.φ, names)
    return dict(zip(names, state_weights(found.normals, names, [], variances)[:, 0], strict=True))


def _towards(job: Job, asked: Start) -> Iterator[Start]:
    now = {name: job.start.get(name, 0.0) for name in asked}
    return ({name: now[name] + share * (z - now[name]) for name, z in asked.items()} for share in CORRECTED)


def _comes_nearer(job: Job, x: Array, than: Array) -> bool:
    """Whether x [L + 1, V, 3] m lies nearer to what was seen."""
    observed = job.recording.observed[job.window.frames][1:]
    return bool(np.nansum((observed - x[1:]) ** 2) < np.nansum((observed - than[1:]) ** 2))


def _without_state_fields(found: Prediction, n: Normals, residual: Array, prior: Prior) -> tuple[Array, Prediction]:
    """Residual and columns less what the start state's posterior mean explains of each."""
    z, x = state_names(n.names), [name for name in n.names if name[:2] not in NUISANCES]
    weights = state_weights(n, z, x, prior.variances(z))
    S = np.stack([found.columns[name] for name in z], -1)
    columns = {name: found.columns[name] - S @ weights[:, k] for k, name in enumerate(x, 1)}
    return residual - S @ weights[:, 0], replace(found, columns=columns)
