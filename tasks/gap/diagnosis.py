"""The diagnosis, from recordings of one garment to where the base model fails, which effect it lacks, and how far the gap then shrinks.

    states → base refit → finer re-run → tangents of all effects → hypotheses → refit of the leaders → verdict → held-out windows

Everything before the verdict sees the training windows only. `run` maps a function over windows: serially, over processes, or over workers.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.numerics import corrected, finer_offset, size
from tasks.cloth.shooting import BaseFit, Evidence, Job, Map, Prior, follow, moved, refit, with_fabric, without_state
from tasks.cloth.start_state import States, states
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import Recording, Window, windows
from tasks.cloth.yielded_collider import with_yielded_collider
from tasks.effects.effect import Effect
from tasks.effects.model import Model
from tasks.gap.acceleration import effect_acceleration, residual_acceleration
from tasks.gap.held_out import Shrinkage, shrinkage
from tasks.gap.hypotheses import Fitted, Windows
from tasks.gap.verdict import Candidate, Search, Verdict, judge, plausibility, withdrawn

Array = NDArray[np.float64]

MODES = 40  # smooth modes of the start state, times three directions, place and velocity
START_NOISE = 1.5  # variance of a residual that noise explains, in noise variances: the start errs too
NUMERICS = 3.0  # the same for the discretisation, in squares of the difference to the finer re-run
ITERATIONS = 4  # of the base refit
LEADERS = 4  # hypotheses that are refitted with the simulator
CONTENDER = 0.05  # least probability of a class whose members are
PARTNERS = 6  # leaders whose pairs are tried
HELD = 0.3  # share of each recording kept for the end where no recording is given for it
FEWEST_WINDOWS = 4  # of training windows that can be followed


@dataclass(frozen=True)
class Data:
    """Recordings of one garment with the states their windows start from."""

    recordings: tuple[Recording, ...]
    states: tuple[States, ...]
    windows: tuple[Window, ...]

    def only(self, windows: Iterable[Window]) -> "Data":
        """Some of the windows."""
        return replace(self, windows=tuple(windows))


@dataclass(frozen=True)
class Screened:
    """The refitted base, the training windows' evidence with all tangents, and the hypotheses, best first."""

    base: BaseFit
    evidence: tuple[Evidence, ...]
    windows: Windows
    hypotheses: tuple[Fitted, ...]


@dataclass(frozen=True)
class Diagnosis:
    """The answer and what it rests on.

    before, after [n, V, 3] m: residuals of the windows' frames, NaN where not seen; zone [V]; vertex_accel [V] m/s²; frame_mm [T] of the
    first recording; parameters: ratios of stiffness to density with intervals.
    """

    verdict: Verdict
    shrinkage: Shrinkage
    before: Array
    after: Array
    zone: NDArray[np.str_]
    vertex_accel: Array
    frame_mm: Array
    parameters: dict[str, dict[str, Any]]
    base: Model
    named: Model
    screened: Screened | None


@dataclass(frozen=True)
class Refitted:
    """A hypothesis after a refit with the simulator: its model, how it fits, the evidence of its windows, and these linear about it."""

    hypothesis: Fitted
    model: Model
    evidence: tuple[Evidence, ...]
    windows: Windows | None


def gather(model: Model, recordings: Sequence[Recording], run: Map = map) -> Data:
    """States and windows of recordings; windows that start where the cloth could not be brought to what was seen are left out."""
    found = list(run(_states, [(model, r) for r in recordings]))
    yielded, walked = zip(*found, strict=True)
    cut = windows(yielded, model.subject.fps)
    return Data(yielded, walked, tuple(w for w in cut if w.start < len(walked[w.recording].x)))


def _states(job: tuple[Model, Recording]) -> tuple[Recording, States]:
    model, recording = job
    recording = with_yielded_collider(recording, model)
    return recording, states(model, recording.motion, recording.observed, float(np.median(recording.noise)))


def split(data: Data) -> tuple[Data, Data]:
    """Training windows, and the last part of each recording to hold out (none where a recording is too short)."""
    train, held = [], []
    for k in range(len(data.recordings)):
        own = [w for w in data.windows if w.recording == k]
        count = round(HELD * len(own)) if len(own) > FEWEST_WINDOWS else 0
        train += own[: len(own) - count]
        held += own[len(own) - count :]
    return data.only(train), data.only(held)


def jobs(model: Model, data: Data, φ: Array, **options) -> list[Job]:
    """One job per window."""
    return [Job(model, data.recordings[w.recording], w, data.states[w.recording], φ, **options) for w in data.windows]


def screen(
    model: Model,
    data: Data,
    effects: Sequence[Effect],
    *,
    iterations: int = ITERATIONS,
    run: Map = map,
    tell: Callable[[str], None] = lambda text: None,
) -> Screened:
    """Base refit, numerics, and the tangents of all effects on the training windows; no iterations where the base is known."""
    φ = smooth_modes(model.subject.cloth, MODES)
    noise = _noise(data.recordings)
    base = refit(jobs(model, data, φ), noise=noise, iterations=iterations, run=run, tell=tell)
    followed = [e.prediction.complete for e in base.evidence]
    data = data.only(w for w, ok in zip(data.windows, followed, strict=True) if ok)
    coarse = [e.prediction.x for e in base.evidence if e.prediction.complete]
    tell("finer re-run")
    offsets = list(run(_offset, list(zip(jobs(base.model, data, φ), coarse, strict=True))))
    tell("tangents of all effects")
    suspicious = replace(base.model, effects=tuple(effects))
    plain = jobs(suspicious, data, φ, columns=True, prior=base.prior)
    evidence = tuple(run(follow, [replace(job, offset=_known(o, x)) for job, o, x in zip(plain, offsets, coarse, strict=True)]))
    compared = compress(evidence, base.prior, effects)
    return Screened(base, evidence, compared, tuple(ranked(compared)))


def _offset(job: tuple[Job, Array]) -> Array | None:
    return finer_offset(*job)


def _known(offset: Array | None, coarse: Array) -> Array:
    return np.zeros_like(coarse[1:]) if offset is None else offset


def compress(evidence: Sequence[Evidence], prior: Prior, effects: Sequence[Effect]) -> Windows:
    """Normal equations with start state and numerics integrated out."""
    return Windows([corrected(without_state(e.normals, prior)) for e in evidence if e.prediction.complete], effects)


def ranked(compared: Windows) -> list[Fitted]:
    """Singles, and pairs of the leading ones, best score first."""
    singles = sorted((compared.fit([e]) for e in compared.effects), key=lambda f: -f.score)
    leading = [f.effects[0] for f in singles[:PARTNERS] if f.score > 0]
    pairs = [compared.fit(pair) for pair in combinations(leading, 2)]
    return sorted([*singles, *pairs], key=lambda f: -f.score)


def refitted(
    screened: Screened, data: Data, hypothesis: Fitted, effects: Sequence[Effect], *, start: Model | None = None, run: Map = map
) -> Refitted:
    """The training windows followed once more with the hypothesis' effects at their strengths, and what a last linear step adds.

    start: the model that the hypothesis was linear about (default: the refitted base). All effects keep their tangents.
    """
    base, fabric = screened.base, (start or screened.base.model).subject.fabric
    model = with_fabric(base.model, moved(fabric, hypothesis.base)[0])
    model = replace(model, effects=tuple(effects), strengths={e.name: hypothesis.θ(e) for e in hypothesis.effects})
    φ = smooth_modes(model.subject.cloth, MODES)
    data = data.only(e.prediction.window for e in screened.evidence)
    todo = jobs(model, data, φ, columns=True, prior=base.prior)
    evidence = tuple(run(follow, [replace(job, offset=e.offset) for job, e in zip(todo, screened.evidence, strict=True)]))
    if not all(e.prediction.complete for e in evidence):
        return Refitted(replace(hypothesis, gains=np.full(len(evidence), -1.0)), model, evidence, None)
    normals = [corrected(without_state(e.normals, base.prior)) for e in evidence]
    after = screened.windows.about(normals, hypothesis.strengths).fit(hypothesis.effects)
    return Refitted(after, model, evidence, Windows(normals, effects, hypothesis.strengths))


def searched(named: Refitted) -> Search | None:
    """Second effects beside a single one that was simulated: what it leaves, they may explain."""
    if named.windows is None or len(named.hypothesis.effects) != 1:
        return None
    own = named.hypothesis.effects[0]
    pairs = tuple(named.windows.fit([own, e]) for e in named.windows.effects if e.name != own.name)
    return Search(named.windows.fit([own]), pairs)


def diagnose(
    model: Model,
    recordings: Sequence[Recording],
    effects: Sequence[Effect],
    *,
    held_out: Callable[[], Sequence[Recording]] | None = None,
    quick: bool = False,
    run: Map = map,
    tell: Callable[[str], None] = lambda text: None,
) -> Diagnosis:
    """The whole diagnosis of one garment. `held_out` is called, and its recordings first read, when the verdict is fixed."""
    tell("states")
    data = gather(model, recordings, run)
    train, held = (data, None) if held_out is not None else split(data)
    doubt = _untestable(data, train)
    if doubt:
        return _unanswered(model, recordings, doubt)
    screened = screen(model, train, effects, run=run, tell=tell)
    if len(screened.evidence) < FEWEST_WINDOWS:
        return _unanswered(
            screened.base.model, recordings, f"the simulation can follow only {len(screened.evidence)} windows of the recording"
        )
    verdict, named = _decided(screened, train, effects, unexplained(screened, _noise(recordings)), quick, run, tell)
    tell("held-out windows")
    kept = gather(screened.base.model, held_out(), run) if held_out is not None else held
    return _concluded(screened, verdict, named, train, kept, run)


def _decided(
    screened: Screened, train: Data, effects: Sequence[Effect], doubt: float, quick: bool, run: Map, tell: Callable[[str], None]
) -> tuple[Verdict, Refitted]:
    """The verdict after the leading hypotheses were simulated, and the named one as simulated last."""
    verdict = judge(screened.hypotheses, unexplained=doubt)
    nothing = Refitted(screened.windows.base, screened.base.model, screened.evidence, screened.windows)
    if verdict.named is None:
        return verdict, nothing
    after = {h.name: _told(screened, train, h, effects, run, tell) for h in contenders(verdict, 1 if quick else LEADERS)}
    hypotheses = [after[h.name].hypothesis if h.name in after else h for h in screened.hypotheses]
    verdict = judge(hypotheses, unexplained=doubt)
    if verdict.named is None:
        return verdict, nothing
    single = max((h for h in hypotheses if len(h.effects) == 1), key=lambda h: h.score + plausibility(h))
    if single.name in after:
        verdict = judge(hypotheses, unexplained=doubt, search=searched(after[single.name]))
    if verdict.named is None:
        return verdict, nothing
    name = verdict.named.name
    if name not in after:
        start = after[single.name].model if single.name in after and len(verdict.named.effects) == 2 else None
        tell(f"refit with {name}")
        after[name] = refitted(screened, train, verdict.named, effects, start=start, run=run)
    return replace(verdict, named=after[name].hypothesis), after[name]


def contenders(verdict: Verdict, most: int) -> list[Fitted]:
    """Hypotheses worth a refit with the simulator: the named one, and what its class or the next best class leads with."""
    found = [verdict.named]
    for candidate in verdict.ranking:
        if candidate.fitted is not None and candidate.probability > CONTENDER:
            found += [h for h in (candidate.fitted, *candidate.others) if h.name not in {f.name for f in found}]
    return found[:most]


def _told(screened: Screened, data: Data, hypothesis: Fitted, effects: Sequence[Effect], run: Map, tell: Callable[[str], None]) -> Refitted:
    tell(f"refit with {hypothesis.name}")
    return refitted(screened, data, hypothesis, effects, run=run)


def unexplained(screened: Screened, noise: float) -> float:
    """Doubt in 0..1 that the library holds the cause: the share of the misfit, beyond noise and numerics, that even the best leaves."""
    base, best = screened.windows.base.misfits.sum(), min(h.misfits.sum() for h in screened.hypotheses)
    residual = np.nanmean([np.nanmean(np.sum(e.residual**2, -1)) for e in screened.evidence])
    known = START_NOISE * 3 * noise**2 + NUMERICS * np.mean([size(e) ** 2 for e in screened.evidence])
    excess = max(0.0, 1 - known / max(residual, 1e-30))
    return float(np.clip(best / base, 0, 1) * excess)


def _noise(recordings: Sequence[Recording]) -> float:
    return float(np.median([np.median(r.noise) for r in recordings]))


def _untestable(data: Data, train: Data) -> str:
    stuck = [f"recording {k}: {s.ending}" for k, s in enumerate(data.states) if len(s.x) < len(data.recordings[k])]
    if len(train.windows) < FEWEST_WINDOWS:
        return "; ".join(stuck) or f"{len(train.windows)} windows of a fifth of a second are too few, {FEWEST_WINDOWS} are needed"
    return ""


def _concluded(screened: Screened, verdict: Verdict, named: Refitted, train: Data, kept: Data | None, run: Map) -> Diagnosis:
    base, prior = screened.base, screened.base.prior
    held = kept is not None and bool(kept.windows)
    floor = 1e3 * np.sqrt(3 * np.mean([np.mean(r.noise**2) for r in train.recordings]) + np.mean([size(e) ** 2 for e in screened.evidence]))
    before, after = list(screened.evidence), list(named.evidence)
    if held:
        φ = smooth_modes(base.model.subject.cloth, MODES)
        before = list(run(follow, jobs(base.model, kept, φ, prior=prior)))
        after = before if verdict.named is None else list(run(follow, jobs(corrected_model(named), kept, φ, prior=prior)))
    gap = shrinkage(before, after, floor_mm=float(floor), held_out=held)
    if verdict.named is not None and held and gap.closed_fraction is not None and not gap.shrinks:
        reason = f"{verdict.named.name} leads, but on motion kept out of the fit the gap does not shrink"
        verdict = withdrawn(verdict, reason)
    fps = base.model.subject.fps
    accel = effect_acceleration(named.evidence, verdict.named, fps) if verdict.named else residual_acceleration(screened.evidence, fps)
    final = corrected_model(named) if verdict.named is not None else base.model
    r = [np.concatenate([e.residual for e in evidence if e.residual is not None]) for evidence in (before, after)]
    return Diagnosis(
        verdict, gap, *r, base.model.subject.zone, accel, _by_frame(screened.evidence, train), ratios(screened), base.model, final, screened
    )


def corrected_model(named: Refitted) -> Model:
    """The model of a refit after its last linear step."""
    h = named.hypothesis
    fabric = moved(named.model.subject.fabric, h.base)[0]
    return with_fabric(replace(named.model, effects=h.effects, strengths={e.name: h.θ(e) for e in h.effects}), fabric)


def ratios(screened: Screened) -> dict[str, dict[str, Any]]:
    """κ_s/ρ and κ_b/ρ [m³/kg] of the refitted base, 90 % intervals by the jackknife over windows."""
    fabric, sd = screened.base.model.subject.fabric, np.sqrt(np.maximum(np.diag(screened.windows.base.base_covariance), 0))
    found = {}
    for name, value, s in zip(("kappa_s_over_rho", "kappa_b_over_rho"), (fabric.membrane, fabric.bending), sd, strict=True):
        ratio = value / fabric.density
        found[name] = {"value": ratio, "low": ratio * np.exp(-1.645 * s), "high": ratio * np.exp(1.645 * s), "unit": "m3/kg"}
    return found


def _by_frame(evidence: Sequence[Evidence], train: Data) -> Array:
    """Root mean square residual [mm] of each frame of the first recording; NaN where no window looks."""
    mm = np.full(len(train.recordings[0]), np.nan)
    for e in evidence:
        w = e.prediction.window
        if w.recording == 0:
            mm[w.start + 1 : w.start + 1 + w.length] = [1e3 * np.sqrt(np.nanmean(np.sum(r**2, -1))) for r in e.residual]
    return mm


def _unanswered(model: Model, recordings: Sequence[Recording], reason: str) -> Diagnosis:
    V, T = recordings[0].observed.shape[1], len(recordings[0])
    nothing = np.full((1, V, 3), np.nan)
    ranking = (Candidate(("none",), 0.5), Candidate(("outside_library",), 0.5))
    verdict = Verdict("not_testable", None, (), 1.0, ranking, reason)
    gap = Shrinkage(np.nan, np.nan, np.nan, None, None, None, False)
    return Diagnosis(verdict, gap, nothing, nothing, model.subject.zone, np.full(V, np.nan), np.full(T, np.nan), {}, model, model, None)
