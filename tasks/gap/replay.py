"""Recordings replayed in one run from their first state: does the model come as near as its own discretisation lets it?

Within a fifth of a second a cause that acts slowly hides behind the uncertain start; over the whole recording it adds up. A replay starts
where its first frames, up to `LONG_S`, ask for (`shooting.nearer_start`, in `STARTING` smooth modes): a velocity off by 10 mm/s would lead
it a centimetre astray. Replays of cloth diverge from one another too, so the yardstick are two other replays, one of them on a finer mesh,
each from a start that other errors of tracking would have led to:

    ratio² = E/E_0,    E = Σ_t w_t ⟨|y − x|²⟩_t,    E_0 = Σ_t w_t F_t,    F_t = 3σ² + max ⟨|x_other − x|²⟩_t,    w_t ∝ 1/F_t,    Σ_t w_t = 1

with ⟨·⟩_t over vertices. Each frame counts over its own floor: once folds have fallen, replays are centimetres apart, and frames that
nobody can foretell would drown those before. The farther of two, for one alone may have parted little by chance: of six of a null skirt, on
either mesh, the nearest ended 4.9 mm off, the farthest 10.6.

About one where nothing is missing, whatever the cloth does; 1 + d²/E_0 where a cause moves it by d. It tells that something is missing;
what, its derivatives foretell roughly, for few hold that long (`joint_estimate.py`). Noise is known, how far replays part by chance is told
by two of them: log ratio² scatters by

    s² = `NOISY`² + (`PARTING` c)²,    c = Σ_t w_t max ⟨|x_other − x|²⟩_t/E_0

about that. As a Bayes factor, with log ratio² normal and d log-uniform over `DISPLACEMENTS`,

    log ⟨N(log ratio²; log(1 + d²/E_0))⟩_d − log N(log ratio²; 0),    within `MOST`: folds fall one way or the other by chance

so that a floor of centimetres, where folds never fall twice alike, says little.

A hypothesis that was simulated is replayed too, and ends E_h from the recording and d from the base's replay. Were it true, the base would
be off by E_0 + d² and it by E_0; were nothing missing, the other way round:

    log Bayes factor = m (log E − log E_h)/s²,    m = log(1 + d²/E_0)    (difference of the four Gaussian exponents)

with d² less what replays that start alike part by anyway, Σ_t w_t max ⟨|x_other − x|²⟩_t: noise has no part in that. At most what is left
of `MOST_NAMED` once ½ (log ratio²/LEAVES)² of E_h is taken off: of two causes that both come far nearer than the base, the one that leaves
least.

Source: posterior predictive checks (Gelman, Meng & Stern 1996). Limits: says nothing where a replay cannot be finished.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.numerics import on_finer_mesh
from tasks.cloth.shooting import Job, Map, follow, nearer_start
from tasks.cloth.start_state import States, states
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import LONG_S, Normals, Prediction, Recording, Window, predict
from tasks.effects.effect import Effect
from tasks.effects.model import Model
from tasks.gap.gathered import Gathered, restarted

Array = NDArray[np.float64]

NOISY, PARTING = 0.15, 0.45  # standard deviation of log ratio² where noise is all of the floor, and what chance adds where that is
DISPLACEMENTS = np.geomspace(1.5e-3, 6e-2, 20)  # [m], of causes worth a name
MOST = (-2.0, 3.0)
MOST_NAMED = (-3.0, 12.0)  # of a hypothesis' own factor
LEAVES = 0.8  # standard deviation of log ratio² that a cause may leave, for another may stand beside it
STARTING = 40  # modes in which the start of a replay may be wrong


@dataclass(frozen=True)
class Replayed:
    """E and E_0 [m²], means over recordings; NaN where no replay could be compared. apart: d² from the base's replay [m²]; chance: of
    E_0 what replays that start alike part by [m²].
    """

    gap: float
    floor: float
    apart: float = 0.0
    chance: float = 0.0

    @property
    def ratio2(self) -> float:
        """E/E_0."""
        return self.gap / self.floor

    @property
    def spread(self) -> float:
        """Standard deviation s of log ratio² about what it should be."""
        return float(np.hypot(NOISY, PARTING * self.chance / self.floor))

    @property
    def something_missing(self) -> float:
        """Log Bayes factor of "something is missing" against "nothing is"; 0 where no replay could be compared."""
        if not np.isfinite(self.ratio2):
            return 0.0
        z = np.log(max(self.ratio2, 1e-12))
        present = np.mean(np.exp(-0.5 * ((z - np.log1p(DISPLACEMENTS**2 / self.floor)) / self.spread) ** 2))
        return float(np.clip(np.log(max(present, 1e-300)) + 0.5 * (z / self.spread) ** 2, *MOST))


@dataclass(frozen=True)
class Replay:
    """How far a recording's replay is off, its frames, the replay x [L + 1, V, 3] m, the base's floors F [L] m², and about it, in
    base parameters and effects, E(θ) = c − 2gᵀθ + θᵀGθ [m²]."""

    replayed: Replayed
    window: Window
    x: Array
    floor: Array
    normals: Normals

    def holds(self, window: Window) -> bool:
        """Whether it passes through a window of its recording."""
        return self.window.start <= window.start and window.start + window.length <= self.window.start + self.window.length

    def within(self, recording: Recording, window: Window, boundary: Array) -> tuple[Array, Array]:
        """Observed minus replayed [L, V, 3] m in a window that the replay passes through, NaN at driven vertices, and F [L] m² there."""
        t = window.start - self.window.start
        return _residual(recording, window, self.x[t : t + window.length + 1], boundary), self.floor[t : t + window.length]


def supported(base: Replayed, named: Replayed) -> float:
    """Log Bayes factor of a hypothesis against the base by their replays; 0 where they cannot be compared."""
    m = np.log1p(max(named.apart - named.chance, 0.0) / named.floor)
    factor = m * np.log(base.gap / named.gap) / named.spread**2
    if not np.isfinite(factor):
        return 0.0
    low, high = MOST_NAMED
    return float(np.clip(factor, low, max(low, high - 0.5 * (np.log(max(named.ratio2, 1.0)) / LEAVES) ** 2)))


def replays(model: Model, data: Gathered, *, columns: bool = False) -> list[Job]:
    """One job per recording: from its first window to the end of its last. What lies between windows is simulated, but not looked at."""
    found, φ = [], smooth_modes(model.subject.cloth, STARTING)
    for k, recording in enumerate(data.compared()):
        own = [w for w in data.windows if w.recording == k]
        if own:
            whole = Window(k, own[0].start, own[-1].start + own[-1].length - own[0].start)
            found.append(Job(model, recording, whole, data.states[k], φ, columns=columns))
    return found


def base_replays(model: Model, effects: Sequence[Effect], data: Gathered, run: Map = map) -> list[Replay | None]:
    """Of each recording, with derivatives by all effects; None where a replay ends early."""
    plain = replays(model.joined(effects, {}), data, columns=True)
    others = replays(model, data)
    found = list(run(_followed, [(job, False, None) for job in plain] + [(job, *way) for way in ((True, 0), (False, 1)) for job in others]))
    each = [found[k :: len(plain)] for k in range(len(plain))]
    return [_beside_others(job, own, others) for job, (own, *others) in zip(plain, each, strict=True)]


def replayed_by(
    model: Model, base: Sequence[Replay | None], data: Gathered, run: Map = map, *, columns: bool = False
) -> tuple[Replay | None, ...]:
    """The same of another model, or fabric, beside the base's floors; columns: with derivatives by its effects."""
    (found,) = replayed_by_each([model], base, data, run, columns=columns)
    return found


def replayed_by_each(
    models: Sequence[Model], base: Sequence[Replay | None], data: Gathered, run: Map = map, *, columns: bool = False
) -> list[tuple[Replay | None, ...]]:
    """The same of several models, all recordings of all of them side by side."""
    known = [_known(model, base, data, run, columns=columns) for model in models]
    found = iter(run(_beside_base, [job for each in known for job in each]))
    return [tuple(None if b is None else next(found) for b in base) for _ in models]


def _known(model: Model, base: Sequence[Replay | None], data: Gathered, run: Map, *, columns: bool) -> list[tuple[Job, Replay]]:
    each = zip(replays(model, restarted(model, data, run), columns=columns), base, strict=True)
    return [(job, b) for job, b in each if b is not None]


def nearer(one: Sequence[Replay | None], other: Sequence[Replay | None]) -> bool:
    """Whether replays come nearer than others of the same recordings, and none was lost."""
    return not lost(one, other) and mean(one).gap < mean(other).gap


def lost(one: Sequence[Replay | None], other: Sequence[Replay | None]) -> bool:
    """Whether one of the recordings that others replay could not be replayed."""
    return any(a is None and b is not None for a, b in zip(one, other, strict=True))


def mean(each: Sequence[Replay | None]) -> Replayed:
    """Over recordings that could be compared."""
    known = [r.replayed for r in each if r is not None]
    if not known:
        return Replayed(np.nan, np.nan, np.nan, np.nan)
    return Replayed(*(float(np.mean([getattr(r, key) for r in known])) for key in ("gap", "floor", "apart", "chance")))


def mean_normals(each: Sequence[Replay | None]) -> Normals | None:
    """Over recordings that could be compared; None where there are none."""
    known = [r.normals for r in each if r is not None]
    if not known:
        return None
    G, g, c = (sum(getattr(n, key) for n in known) / len(known) for key in ("G", "g", "c"))
    return Normals(known[0].names, G, g, c, sum(n.n for n in known))


def parted(one: Sequence[Replay | None], other: Sequence[Replay | None]) -> float:
    """d² [m²] between replays of the same recordings, mean over recordings; NaN where none can be compared.

    Of all vertices and frames, seen or not: what two models do there needs no observation.
    """
    both = [(a, b) for a, b in zip(one, other, strict=True) if a is not None and b is not None]
    return float(np.mean([weighted((a.x - b.x)[1:], b.floor) for a, b in both])) if both else np.nan


def weighted(r: Array, floor: Array) -> float:
    """Σ_t w_t ⟨|r|²⟩_t of what was seen of r [L, V, 3] m, each frame over its own floor [L] m²."""
    each = np.sum(r**2, -1) / floor[:, None]
    return float(np.nansum(each) / np.sum(np.isfinite(each) / floor[:, None]))


def _beside_base(job: tuple[Job, Replay]) -> Replay | None:
    todo, base = job
    found = _predicted(_well_started(todo), todo.model)
    if not found.complete:
        return None
    r, floor = _residual_of(todo, found.x), base.floor
    here = replace(base.replayed, gap=weighted(r, floor), apart=weighted((found.x - base.x)[1:], floor))
    return Replay(here, todo.window, found.x, floor, _normals(found, r, floor))


def _followed(job: tuple[Job, bool, int | None]) -> Prediction | None:
    """The replay, on a finer mesh or not, from the states or as other errors of tracking would have led it; None where it ends early."""
    todo, finer, seed = job
    started = _well_started(todo if seed is None else _seen_otherwise(todo, seed))
    found = _predicted(started, on_finer_mesh(todo.model) if finer else todo.model)
    return replace(found, x=found.x[:, : todo.recording.observed.shape[1]]) if found.complete else None


def _predicted(job: Job, model: Model) -> Prediction:
    parameters = job.parameters if job.columns else ()
    return predict(model, job.recording, job.window, job.states, parameters=parameters, columns=job.columns)


def _normals(found: Prediction, r: Array, floor: Array) -> Normals:
    """E about a replay whose residual is r [L, V, 3] m."""
    seen = np.isfinite(r)
    w = np.broadcast_to(1 / floor[:, None, None], r.shape)[seen]
    A = np.stack([r[seen], *(column[seen] for column in found.columns.values())], 1)
    G = (A.T * w) @ A / (w.sum() / 3)
    return Normals(tuple(found.columns), G[1:, 1:], G[1:, 0], float(G[0, 0]), len(A))


def _beside_others(job: Job, own: Prediction | None, others: Sequence[Prediction | None]) -> Replay | None:
    finished = [other.x for other in others if other is not None]
    if own is None or not finished:
        return None
    r, noise = _residual_of(job, own.x), job.recording.noise[job.window.frames][1:]
    seen, free = np.isfinite(r).all(-1), ~np.isin(np.arange(r.shape[1]), job.model.subject.cloth.boundary)
    parting = np.max([np.mean(np.sum((y - own.x)[1:, free] ** 2, -1), 1) for y in finished], 0)
    floor = 3 * np.mean(noise[seen] ** 2) + parting
    w = seen.sum(1) / floor / np.sum(seen / floor[:, None])
    here = Replayed(weighted(r, floor), float(w @ floor), chance=float(w @ parting))
    return Replay(here, job.window, own.x, floor, _normals(own, r, floor))


def _first(job: Job) -> Window:
    """The frames that tell where a replay starts."""
    return replace(job.window, length=min(job.window.length, round(LONG_S * job.model.subject.fps)))


def _well_started(job: Job) -> Job:
    """The job with the start that its first frames ask for; as it is where they cannot be followed."""
    first = replace(job, window=_first(job), columns=False)
    found = follow(first)
    if not found.prediction.complete:
        return job
    start, _ = nearer_start(first, found)
    return replace(job, states=replace(first, start=start).started)


def _seen_otherwise(job: Job, seed: int) -> Job:
    """The job as it would be with other errors of tracking in its first frames, and the states found from them; as it is where these cannot be found."""
    model, cut = job.recording.scene(job.model), _first(job).frames
    first = job.recording.cut(cut)
    ε = first.correlation.sample(model.subject.cloth.x_rest, first.noise, model.subject.fps, np.random.default_rng(seed))
    found = states(model, model.driven(job.recording.motion).cut(cut), first.observed + ε, float(np.median(first.noise)))
    if not len(found.x):
        return job
    observed, x, v = job.recording.observed.copy(), job.states.x.copy(), job.states.v.copy()
    observed[cut] += ε
    own = slice(cut.start, cut.start + len(found.x))
    x[own], v[own] = found.x, found.v
    return replace(job, recording=replace(job.recording, observed=observed), states=States(x, v, job.states.ending))


def _residual(recording: Recording, window: Window, x: Array, boundary: Array) -> Array:
    """Observed minus replayed [L, V, 3] m, NaN at driven vertices."""
    r = recording.observed[window.frames][1:] - x[1:]
    r[:, boundary] = np.nan
    return r


def _residual_of(job: Job, x: Array) -> Array:
    return _residual(job.recording, job.window, x, job.model.subject.cloth.boundary)
