"""Recordings replayed in one run from their first state: does the model come as near as its own discretisation lets it?

Within a fifth of a second a cause that acts slowly hides behind the uncertain start; over the whole recording it adds up. Replays of cloth diverge from
one another too, so the yardsticks are the finer replay from the same start, and one from the start that other errors of tracking would have led to:

    ratio² = E/E_0,    E = mean |y − x|²,    E_0 = 3σ² + mean |x_finer − x|² + mean |x_other start − x|²    over vertices and frames

About one where nothing is missing, whatever the cloth does; 1 + d²/E_0 where a cause moves it by d. It tells that something is missing, not what: no
derivative holds that long. As a Bayes factor, with log ratio² normal of standard deviation `SPREAD` about that and d log-uniform over `DISPLACEMENTS`,

    log ⟨N(log ratio²; log(1 + d²/E_0))⟩_d − log N(log ratio²; 0),    within `MOST`: folds fall one way or the other by chance

so that a floor of centimetres, where folds never fall twice alike, says little.

Source: posterior predictive checks (Gelman, Meng & Stern 1996). Limits: says nothing where a replay cannot be finished.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.numerics import finer_offset
from tasks.cloth.shooting import Job, Map
from tasks.cloth.start_state import FRAMES, States, states
from tasks.cloth.windows import Window, predict
from tasks.effects.model import Model
from tasks.gap.gathered import Gathered, restarted

Array = NDArray[np.float64]

SPREAD = 0.4  # of log ratio² about what it should be
DISPLACEMENTS = np.geomspace(1.5e-3, 6e-2, 20)  # [m], of causes worth a name
MOST = (-2.0, 3.0)


@dataclass(frozen=True)
class Replayed:
    """E and E_0 [m²], means over recordings; NaN where no replay could be compared."""

    gap: float
    floor: float

    @property
    def ratio2(self) -> float:
        """E/E_0."""
        return self.gap / self.floor

    @property
    def something_missing(self) -> float:
        """Log Bayes factor of "something is missing" against "nothing is"; 0 where no replay could be compared."""
        if not np.isfinite(self.ratio2):
            return 0.0
        z = np.log(max(self.ratio2, 1e-12))
        present = np.mean(np.exp(-0.5 * ((z - np.log1p(DISPLACEMENTS**2 / self.floor)) / SPREAD) ** 2))
        return float(np.clip(np.log(max(present, 1e-300)) + 0.5 * (z / SPREAD) ** 2, *MOST))


def replays(model: Model, data: Gathered) -> list[Job]:
    """One job per recording: from its first window to the end of its last."""
    found = []
    for k in range(len(data.recordings)):
        own = [w for w in data.windows if w.recording == k]
        if own:
            whole = Window(k, own[0].start, own[-1].start + own[-1].length - own[0].start)
            found.append(Job(model, data.recordings[k], whole, data.states[k], np.zeros((0, 0))))
    return found


def base_replays(model: Model, data: Gathered, run: Map = map) -> list[Replayed | None]:
    """Of each recording; None where a replay ends early."""
    return list(run(_beside_others, replays(model, data)))


def replayed_by(model: Model, base: Sequence[Replayed | None], data: Gathered, run: Map = map) -> list[Replayed | None]:
    """The same of another model, beside the base's floors."""
    gaps = run(_gap, replays(model, restarted(model, data, run)))
    return [None if E is None or own is None else Replayed(E, own.floor) for E, own in zip(gaps, base, strict=True)]


def mean(each: Sequence[Replayed | None]) -> Replayed:
    """Over recordings that could be compared."""
    known = [r for r in each if r is not None]
    if not known:
        return Replayed(np.nan, np.nan)
    return Replayed(float(np.mean([r.gap for r in known])), float(np.mean([r.floor for r in known])))


def _gap(job: Job) -> float | None:
    """E [m²]."""
    found = predict(job.model, job.recording, job.window, job.states)
    return _mean_square(_residual(job, found.x)) if found.complete else None


def _beside_others(job: Job) -> Replayed | None:
    found = predict(job.model, job.recording, job.window, job.states)
    other = predict(job.model, job.recording, job.window, _started_otherwise(job)) if found.complete else found
    finer = finer_offset(job, found.x) if other.complete else None
    if finer is None:
        return None
    r, noise = _residual(job, found.x), job.recording.noise[job.window.frames][1:]
    free = np.setdiff1d(np.arange(r.shape[1]), job.model.subject.cloth.boundary)
    own = 3 * np.mean(noise[np.isfinite(r).all(-1)] ** 2)
    floor = float(own + _mean_square(finer[:, free]) + _mean_square((other.x - found.x)[1:, free]))
    return Replayed(_mean_square(r), floor)


def _started_otherwise(job: Job) -> States:
    """The states, the first as it would be found with other errors of tracking added; as they are where it cannot be found."""
    t, model = job.window.start, job.recording.scene(job.model)
    first = job.recording.cut(slice(t, t + FRAMES))
    ε = first.correlation.sample(model.subject.cloth.x_rest, first.noise, np.random.default_rng(0))
    found = states(model, model.driven(first.motion), first.observed + ε, float(np.median(first.noise)))
    if not len(found.x):
        return job.states
    x, v = job.states.x.copy(), job.states.v.copy()
    x[t], v[t] = found.x[0], found.v[0]
    return States(x, v, job.states.ending)


def _residual(job: Job, x: Array) -> Array:
    """Observed minus replayed [L, V, 3] m, NaN at driven vertices."""
    r = job.recording.observed[job.window.frames][1:] - x[1:]
    r[:, job.model.subject.cloth.boundary] = np.nan
    return r


def _mean_square(r: Array) -> float:
    return float(np.nanmean(np.sum(r**2, -1)))
