"""The diagnosis, from recordings of one garment to where the base model fails, which effect it lacks, and how far the gap then shrinks.

    states → base refit → finer re-run → tangents of all effects → hypotheses → refit of the leaders → verdict → held-out windows

Everything before the verdict sees the training windows only. `run` maps a function over windows: serially, over processes, or over workers.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.chord_shortening import chord_shortening
from tasks.cloth.contact_sagitta import feigned_strengths
from tasks.cloth.numerics import corrected, finer_offset, size
from tasks.cloth.shooting import BaseFit, Evidence, Job, Map, Prior, follow, moved, refit, with_fabric, without_state
from tasks.cloth.start_state import States, states
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import Recording, Window, windows
from tasks.cloth.yielded_collider import with_yielded_collider
from tasks.effects.effect import Effect
from tasks.effects.model import Model
from tasks.gap.acceleration import effect_acceleration, residual_acceleration
from tasks.gap.confusability import confusability
from tasks.gap.held_out import Shrinkage, shrinkage, unchanged
from tasks.gap.hypotheses import NOWHERE, Fitted, Windows
from tasks.gap.interpenetration import cleared
from tasks.gap.verdict import Candidate, Twins, Verdict, judge, twins, withdrawn

Array = NDArray[np.float64]

MODES = 40  # smooth modes of the start state, times three directions, place and velocity
NUMERICS = 1.5  # misfit that the discretisation may leave, in squares of the difference to the finer re-run
TOLERATED = 0.05  # misfit per coordinate that wrongly stated noise may leave
SHARPNESS = 3.0  # of the doubt that the library holds the cause
ITERATIONS, FINAL = 5, 3  # of the base refit, on a few windows and then on all
ROUGH = 4  # windows of the first rounds of the base refit
LEADERS = 3  # hypotheses that are refitted with the simulator
FAR = 0.1  # change of the leading strength by a refit that is worth another one
WORTH = 1.0  # least evidence of one that is,
CONTENDER, SHARE = 4.0, 0.3  # and how far behind the strongest: whichever of the difference and of the share of its evidence is more
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
    first recording; parameters: ratios of stiffness to density with intervals; pairs: second effects that were weighed beside the leading one.
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
    pairs: tuple[Fitted, ...] = ()


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
    return recording, states(recording.scene(model), recording.motion, recording.observed, float(np.median(recording.noise)))


def roughly_refitted(model: Model, data: Data, run: Map = map, tell: Callable[[str], None] = lambda text: None) -> Model:
    """The model after the first rounds of the base refit, on a few of the windows."""
    few = data.only(data.windows[:: max(1, len(data.windows) // ROUGH)])
    φ = smooth_modes(model.subject.cloth, MODES)
    return refit(jobs(model, few, φ), noise=_noise(data.recordings), iterations=ITERATIONS, run=run, tell=tell).model


def restated(model: Model, data: Data, run: Map = map) -> Data:
    """The states that another model finds: cloth too soft keeps the noise as wrinkles, which make it look softer than it is."""
    walked = list(run(_restate, [(model, r) for r in data.recordings]))
    return replace(data, states=tuple(new if len(new.x) >= len(old.x) else old for new, old in zip(walked, data.states, strict=True)))


def restarted(model: Model, data: Data, run: Map = map) -> Data:
    """The same for a model whose effects move the collider: before a body in another place, the cloth is elsewhere too."""
    moved_body = any("motion" in e.acts_through and model.strength(e).any() for e in model.effects)
    return restated(model, data, run) if moved_body else data


def _restate(job: tuple[Model, Recording]) -> States:
    model, recording = job
    model = recording.scene(model)
    return states(model, model.driven(recording.motion), recording.observed, float(np.median(recording.noise)))


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
    feigned: Mapping[str, float] = NOWHERE,
    iterations: int = FINAL,
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
    suspicious = base.model.joined(effects, {})
    plain = jobs(suspicious, data, φ, columns=True, prior=base.prior)
    evidence = tuple(run(follow, [replace(job, offset=_known(o, x)) for job, o, x in zip(plain, offsets, coarse, strict=True)]))
    compared = compress(evidence, base.prior, effects, feigned)
    return Screened(base, evidence, compared, tuple(ranked(compared)))


def feigned(model: Model, data: Data, contact_doubt: float) -> dict[str, float]:
    """Column -> standard deviation of the strength that the coarse mesh alone may feign."""
    scale = chord_shortening(model.subject.cloth, data.states, _noise(data.recordings))
    found = feigned_strengths(data.recordings, contact_doubt, model.subject.fps)
    return found | dict.fromkeys(("fabric_rest_scale", "observation_scale"), scale)


def _offset(job: tuple[Job, Array]) -> Array | None:
    return finer_offset(*job)


def _known(offset: Array | None, coarse: Array) -> Array:
    return np.zeros_like(coarse[1:]) if offset is None else offset


def compress(evidence: Sequence[Evidence], prior: Prior, effects: Sequence[Effect], feigned: Mapping[str, float] = NOWHERE) -> Windows:
    """Normal equations with start state and numerics integrated out."""
    return Windows([corrected(without_state(e.normals, prior)) for e in evidence if e.prediction.complete], effects, feigned=feigned)


def ranked(compared: Windows) -> list[Fitted]:
    """Singles, strongest evidence first."""
    return sorted((compared.fit([e]) for e in compared.effects), key=lambda f: -f.evidence)


def refitted(
    screened: Screened, data: Data, hypothesis: Fitted, effects: Sequence[Effect], *, start: Model | None = None, run: Map = map
) -> Refitted:
    """The training windows followed once more with the hypothesis' effects at their strengths, and what a last linear step adds.

    start: the model that the hypothesis was linear about (default: the refitted base). All effects keep their tangents.
    """
    base, fabric = screened.base, (start or screened.base.model).subject.fabric
    model = with_fabric(base.model, moved(fabric, hypothesis.base)[0])
    model = model.joined(effects, {e.name: hypothesis.θ(e) for e in hypothesis.effects})
    φ = smooth_modes(model.subject.cloth, MODES)
    data = restarted(model, data.only(e.prediction.window for e in screened.evidence), run)
    todo = jobs(model, data, φ, columns=True, prior=base.prior)
    evidence = tuple(run(follow, [replace(job, offset=e.offset) for job, e in zip(todo, screened.evidence, strict=True)]))
    if not all(e.prediction.complete for e in evidence):
        return Refitted(replace(hypothesis, weights=()), model, evidence, None)
    normals = [corrected(without_state(e.normals, base.prior)) for e in evidence]
    about = screened.windows.about(normals, hypothesis.effects, hypothesis.strengths)
    return Refitted(about.fit(hypothesis.effects), model, evidence, about)


def searched(named: Refitted) -> tuple[Fitted, ...]:
    """Second effects beside a single one that was simulated: what it leaves, they may explain."""
    if named.windows is None or len(named.hypothesis.effects) != 1:
        return ()
    own = named.hypothesis.effects[0]
    return tuple(named.windows.fit([own, e]) for e in named.windows.effects if e.name != own.name)


def diagnose(
    model: Model,
    recordings: Sequence[Recording],
    effects: Sequence[Effect],
    *,
    contact_doubt: float = 0.0,
    held_out: Callable[[], Sequence[Recording]] | None = None,
    quick: bool = False,
    run: Map = map,
    tell: Callable[[str], None] = lambda text: None,
) -> Diagnosis:
    """The whole diagnosis of one garment. `held_out` is called, and its recordings first read, when the verdict is fixed.

    contact_doubt [m]: where contact may hold the cloth wrongly because the mesh is coarse.
    """
    tell("states")
    data = gather(model, recordings, run)
    train, held = (data, None) if held_out is not None else split(data)
    doubt = _untestable(data, train)
    if doubt:
        return _unanswered(model, recordings, doubt)
    model = roughly_refitted(model, train, run, tell)
    data = restated(model, data, run)
    train, held = (data, None) if held_out is not None else split(data)
    screened = screen(model, train, effects, feigned=feigned(model, train, contact_doubt), run=run, tell=tell)
    if len(screened.evidence) < FEWEST_WINDOWS:
        return _unanswered(
            screened.base.model, recordings, f"the simulation can follow only {len(screened.evidence)} windows of the recording"
        )
    verdict, named, pairs = _decided(screened, train, effects, _noise(recordings), quick, run, tell)
    tell("held-out windows")
    kept = gather(screened.base.model, held_out(), run) if held_out is not None else held
    return replace(_concluded(screened, verdict, named, train, kept, run), pairs=pairs)


def _decided(
    screened: Screened, train: Data, effects: Sequence[Effect], noise: float, quick: bool, run: Map, tell: Callable[[str], None]
) -> tuple[Verdict, Refitted, tuple[Fitted, ...]]:
    """The verdict after the leading hypotheses were simulated, the named one as simulated last, and the pairs that were weighed."""
    cosines = confusability(screened.windows, screened.windows.effects)
    seen = by_contact(screened, train, effects, noise)
    chosen = contenders(screened.hypotheses, seen, 1 if quick else LEADERS, twins(cosines))
    after = {h.name: _told(screened, train, h, effects, run, tell) for h in chosen}
    singles = [after[h.name].hypothesis if h.name in after else h for h in screened.hypotheses]
    leader = max(singles, key=lambda h: h.evidence)
    if leader.name in after and after[leader.name].windows is not None and moved_on(after[leader.name]):
        after[leader.name] = _told(screened, train, leader, effects, run, tell)
        singles = [after[h.name].hypothesis if h.name == leader.name else h for h in singles]
    pairs = searched(after[leader.name]) if leader.name in after else ()
    verdict = judge(singles, pairs, unexplained=unexplained(screened, after.values()), cosines=cosines)
    if verdict.named is None:
        return verdict, Refitted(screened.windows.base, screened.base.model, screened.evidence, screened.windows), pairs
    name = verdict.named.name
    if name not in after:
        start = after[leader.name].model if leader.name in after and len(verdict.named.effects) == 2 else None
        after[name] = _told(screened, train, verdict.named, effects, run, tell, start=start)
    return replace(verdict, named=after[name].hypothesis), after[name], pairs


def moved_on(named: Refitted) -> bool:
    """Whether the strengths after a refit are far from those it was simulated with: what curvature leaves, a second effect would be blamed for."""
    before = np.concatenate([named.model.strength(e) / e.typical for e in named.hypothesis.effects])
    after = np.concatenate([named.hypothesis.θ(e) / e.typical for e in named.hypothesis.effects])
    return bool(np.linalg.norm(after - before) > FAR * np.linalg.norm(after))


def by_contact(screened: Screened, train: Data, effects: Sequence[Effect], noise: float) -> list[Fitted]:
    """Effects on the body that cloth seen inside it asks for, at the strength that clears it: derivatives cannot tell of them."""
    strengths = cleared(screened.base.model, train.recordings, effects, noise)
    if {"body_lag", "observation_delay"} <= set(strengths):
        del strengths["body_lag"]  # exact opposites: one simulation serves both
    linear = {h.name: h for h in screened.hypotheses}
    return [replace(linear[name], strengths={name: θ}) for name, θ in strengths.items()]


def contenders(singles: Sequence[Fitted], seen: Sequence[Fitted], most: int, alike: Twins) -> list[Fitted]:
    """Hypotheses worth a refit with the simulator: those `seen` otherwise, then those whose evidence, linear about the base, is near the strongest.

    Of twins one is enough. At most `most`, of the others at least one.
    """
    strongest = max(h.evidence for h in singles)
    near = [h for h in singles if h.evidence > max(WORTH, strongest - max(CONTENDER, SHARE * strongest))]
    chosen, same = list(seen), alike | {frozenset((h.name,)) for h in singles}
    for h in sorted(near, key=lambda h: -h.evidence):
        if len(chosen) < max(most, len(seen) + 1) and all(frozenset((h.name, c.name)) not in same for c in chosen):
            chosen.append(h)
    return chosen


def _told(
    screened: Screened,
    data: Data,
    hypothesis: Fitted,
    effects: Sequence[Effect],
    run: Map,
    tell: Callable[[str], None],
    *,
    start: Model | None = None,
) -> Refitted:
    tell(f"refit with {hypothesis.name}")
    return refitted(screened, data, hypothesis, effects, start=start, run=run)


def unexplained(screened: Screened, refits: Iterable[Refitted]) -> float:
    """Doubt in 0..1 that the library holds the cause: odds (e/k)^`SHARPNESS` of the misfit e per coordinate beyond noise that all effects at once leave,
    about the base or about a leader, against what is known to be there: `NUMERICS` times the finer re-run's own size, in the same metric, and `TOLERATED`."""
    about = [screened.windows, *(r.windows for r in refits if r.windows is not None)]
    left = min(w.left(w.effects) for w in about) - 1
    followed = [without_state(e.normals, screened.base.prior) for e in screened.evidence]
    size2 = sum(n.G[i, i] for n in followed for i in n.index(["numerics"])) / sum(n.n for n in followed)
    odds = (max(left, 0.0) / (NUMERICS * size2 + TOLERATED)) ** SHARPNESS
    return float(odds / (1 + odds))


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
        if verdict.named is None:
            after = before
        else:
            final = corrected_model(named)
            after = list(run(follow, jobs(final, restarted(final, kept, run), φ, prior=prior)))
    gap = shrinkage(before, after, floor_mm=float(floor), held_out=held)
    if verdict.named is not None and held and not gap.shrinks:
        reason = f"{verdict.named.name} leads, but on motion kept out of the fit the gap does not shrink"
        verdict, after, gap = withdrawn(verdict, reason), before, unchanged(gap)
    fps = base.model.subject.fps
    accel = effect_acceleration(named.evidence, verdict.named, fps) if verdict.named else residual_acceleration(screened.evidence, fps)
    final = corrected_model(named) if verdict.named is not None else base.model
    r = [np.concatenate([e.residual for e in evidence if e.residual is not None]) for evidence in (before, after)]
    return Diagnosis(
        verdict, gap, *r, base.model.subject.zone, accel, _by_frame(screened.evidence, train), ratios(screened), base.model, final, screened
    )


def corrected_model(named: Refitted) -> Model:
    """The model of a refit after its last linear step."""
    h, model = named.hypothesis, named.model
    fabric = moved(model.subject.fabric, h.base)[0]
    acting = tuple(e for e in model.effects if e.name in model.strengths)  # the others were there for their tangents
    return with_fabric(replace(model, effects=acting, strengths={**model.strengths, **{e.name: h.θ(e) for e in h.effects}}), fabric)


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
