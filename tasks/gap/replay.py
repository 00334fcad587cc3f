"""Recordings replayed in one run from their first state: does the model come as near as its own discretisation lets it?

Within a fifth of a second a cause that acts slowly hides behind the uncertain start; over the whole recording it adds up. Replays of cloth diverge from
one another too, so the yardstick are two other replays, one of them on a finer mesh, each from a start that other errors of tracking would have led to:

    ratio² = E/E_0,    E = mean |y − x|²,    E_0 = 3σ² + max mean |x_other − x|²    over vertices and frames

The farther of two, for one alone may have parted little by chance: of six of a null skirt, on either mesh, the nearest ended 4.9 mm off, the farthest 10.6.

About one where nothing is missing, whatever the cloth does; 1 + d²/E_0 where a cause moves it by d. It tells that something is missing, not what: no
derivative holds that long. As a Bayes factor, with log ratio² normal of standard deviation `SPREAD` about that and d log-uniform over `DISPLACEMENTS`,

    log ⟨N(log ratio²; log(1 + d²/E_0))⟩_d − log N(log ratio²; 0),    within `MOST`: folds fall one way or the other by chance

so that a floor of centimetres, where folds never fall twice alike, says little.

A hypothesis that was simulated is replayed too, and ends E_h from the recording and d from the base's replay. Were it true, the base would be off by
E_0 + d² and it by E_0; were nothing missing, the other way round:

    log Bayes factor = m (log E − log E_h)/SPREAD²,    m = log(1 + d²/E_0)    (difference of the four Gaussian exponents)

with d² less E_0, by which replays that start alike part anyway.

Source: posterior predictive checks (Gelman, Meng & Stern 1996). Limits: says nothing where a replay cannot be finished.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.numerics import on_finer_mesh
from tasks.cloth.shooting import Job, Map
from tasks.cloth.start_state import FRAMES, States, states
from tasks.cloth.windows import Recording, Window, predict
from tasks.effects.model import Model
from tasks.gap.gathered import Gathered, restarted

Array = NDArray[np.float64]

SPREAD = 0.4  # of log ratio² about what it should be
DISPLACEMENTS = np.geomspace(1.5e-3, 6e-2, 20)  # [m], of causes worth a name
MOST = (-2.0, 3.0)
MOST_NAMED = (-3.0, 5.0)  # of a hypothesis' own factor


@dataclass(frozen=True)
class Replayed:
    """E and E_0 [m²], means over recordings; NaN where no replay could be compared. apart: d² from the base's replay [m²]."""

    gap: float
    floor: float
    apart: float = 0.0

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


@dataclass(frozen=True)
class BaseReplay:
    """How far a recording's replay by the base is off, and the replay x [L + 1, V, 3] m."""

    replayed: Replayed
    x: Array


def supported(base: Replayed, named: Replayed) -> float:
    """Log Bayes factor of a hypothesis against the base by their replays; 0 where they cannot be compared."""
    m = np.log1p(max(named.apart - named.floor, 0.0) / named.floor)
    factor = m * np.log(base.gap / named.gap) / SPREAD**2
    return float(np.clip(factor, *MOST_NAMED)) if np.isfinite(factor) else 0.0


def replays(model: Model, data: Gathered) -> list[Job]:
    """One job per recording: from its first window to the end of its last. What lies between windows is simulated, but not looked at."""
    found = []
    for k, recording in enumerate(data.recordings):
        own = [w for w in data.windows if w.recording == k]
        if own:
            whole = Window(k, own[0].start, own[-1].start + own[-1].length - own[0].start)
            found.append(Job(model, _shown(recording, own), whole, data.states[k], np.zeros((0, 0))))
    return found


def _shown(recording: Recording, own: Sequence[Window]) -> Recording:
    """The recording as its windows show it, unseen elsewhere."""
    frames = np.zeros(len(recording), bool)
    for w in own:
        frames[w.frames] = True
    return replace(recording, observed=np.where(frames[:, None, None], recording.observed, np.nan))


def base_replays(model: Model, data: Gathered, run: Map = map) -> list[BaseReplay | None]:
    """Of each recording; None where a replay ends early."""
    todo = replays(model, data)
    found = list(run(_followed, [(job, *way) for way in ((False, None), (True, 0), (False, 1)) for job in todo]))
    each = [found[k :: len(todo)] for k in range(len(todo))]
    return [_beside_others(job, x, others) for job, (x, *others) in zip(todo, each, strict=True)]


def replayed_by(model: Model, base: Sequence[BaseReplay | None], data: Gathered, run: Map = map) -> Replayed:
    """The same of another model, beside the base's floors; mean over recordings that both could finish."""
    known = [(job, b) for job, b in zip(replays(model, restarted(model, data, run)), base, strict=True) if b is not None]
    return mean([r for r in run(_beside_base, known) if r is not None])


def of_base(base: Sequence[BaseReplay | None]) -> Replayed:
    """Mean over recordings."""
    return mean([b.replayed for b in base if b is not None])


def mean(each: Sequence[Replayed]) -> Replayed:
    """Over recordings that could be compared."""
    if not each:
        return Replayed(np.nan, np.nan, np.nan)
    return Replayed(*(float(np.mean([getattr(r, key) for r in each])) for key in ("gap", "floor", "apart")))


def _beside_base(job: tuple[Job, BaseReplay]) -> Replayed | None:
    todo, base = job
    found = predict(todo.model, todo.recording, todo.window, todo.states)
    if not found.complete:
        return None
    r = _residual(todo, found.x)
    return Replayed(_mean_square(r), base.replayed.floor, _mean_square((found.x - base.x)[1:][np.isfinite(r).all(-1)]))


def _followed(job: tuple[Job, bool, int | None]) -> Array | None:
    """The replay [L + 1, V, 3] m, on a finer mesh or not, from the states or from another start; None where it ends early."""
    todo, finer, seed = job
    model = on_finer_mesh(todo.model) if finer else todo.model
    states = todo.states if seed is None else _started_otherwise(todo, seed)
    found = predict(model, todo.recording, todo.window, states)
    return found.x[:, : todo.recording.observed.shape[1]] if found.complete else None


def _beside_others(job: Job, x: Array | None, others: Sequence[Array | None]) -> BaseReplay | None:
    finished = [y for y in others if y is not None]
    if x is None or not finished:
        return None
    r, noise = _residual(job, x), job.recording.noise[job.window.frames][1:]
    seen = np.isfinite(r).all(-1)
    floor = float(3 * np.mean(noise[seen] ** 2) + max(_mean_square((y - x)[1:][seen]) for y in finished))
    return BaseReplay(Replayed(_mean_square(r), floor), x)


def _started_otherwise(job: Job, seed: int) -> States:
    """The states, the first as it would be found with other errors of tracking added; as they are where it cannot be found."""
    t, model = job.window.start, job.recording.scene(job.model)
    first = job.recording.cut(slice(t, t + FRAMES))
    ε = first.correlation.sample(model.subject.cloth.x_rest, first.noise, model.subject.fps, np.random.default_rng(seed))
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
