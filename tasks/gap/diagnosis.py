"""The diagnosis, from recordings of one garment to where the base model fails, which effect it lacks, and how far the gap then shrinks.

    states → base refit → the same computed otherwise → tangents of all effects → hypotheses → refit of the leaders → verdict → held-out windows

Everything before the verdict sees the training windows only. `run` maps a function over windows: serially, over processes, or over workers.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.shooting import Evidence, Map, Prior, follow_corrected
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import Recording
from tasks.effects.effect import Effect
from tasks.effects.model import Model
from tasks.gap.acceleration import effect_acceleration, residual_acceleration
from tasks.gap.gathered import FEWEST_WINDOWS, Gathered, gather, jobs, restarted, restated, split
from tasks.gap.held_out import Shrinkage, floor_mm, shrinkage, unchanged
from tasks.gap.hypotheses import Fitted
from tasks.gap.refits import Refitted, comes_nearer, corrected_model
from tasks.gap.replay import Replayed
from tasks.gap.screening import MODES, Screened, roughly_refitted, screen
from tasks.gap.trials import Trials
from tasks.gap.verdict import Candidate, Verdict, first_alone, judge, withdrawn

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Diagnosis:
    """The answer and what it rests on.

    before, after [n, V, 3] m: residuals of the windows' frames, NaN where not seen; zone [V]; vertex_accel [V] m/s²; frame_mm [T] of the
    first recording; parameters: ratios of stiffness to density with intervals; pairs: second effects that were weighed beside the leading one;
    replayed: the base over whole recordings. named: the model for motions not seen: with the named effect, unless whole recordings replayed with it came
    less near than the base's.
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
    replayed: Replayed | None = None


@dataclass(frozen=True)
class _Decided:
    """The verdict after the leading hypotheses were simulated, the named one as simulated last, the first of two named causes simulated alone, the pairs
    that were weighed, the base's replays."""

    verdict: Verdict
    named: Refitted
    alone: Refitted | None
    pairs: tuple[Fitted, ...]
    replayed: Replayed


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
    first = model
    model, correlation = roughly_refitted(model, train, run, tell)
    data = restated(model, data.correlated(correlation), run)
    train, held = (data, None) if held_out is not None else split(data)
    screened = screen(model, train, effects, contact_doubt=contact_doubt, quick=quick, run=run, tell=tell)
    if len(screened.evidence) < FEWEST_WINDOWS:
        return _unanswered(
            screened.base.model, recordings, f"the simulation can follow only {len(screened.evidence)} windows of the recording"
        )
    decided = _decided(Trials(screened, first, train, effects, run, tell), quick)
    tell("held-out windows")
    kept = gather(screened.base.model, held_out(), run).correlated(correlation) if held_out is not None else held
    return _concluded(screened, decided, train, kept, run)


def _decided(trials: Trials, quick: bool) -> _Decided:
    trials.settle(quick=quick)
    pairs, screened = trials.pairs(), trials.screened
    missing = trials.replayed.something_missing
    verdict = judge(trials.singles, pairs, unexplained=trials.doubt(pairs), missing=missing, cosines=trials.cosines)
    if verdict.named is None:
        nothing = Refitted(screened.windows.base, screened.base.model, screened.evidence, screened.windows)
        return _Decided(verdict, nothing, None, pairs, trials.replayed)
    name = verdict.named.name
    alone = trials.after.get(verdict.named.effects[0].name) if len(verdict.named.effects) == 2 else None
    if name not in trials.after:
        trials.after[name] = trials.simulate(verdict.named, alone and alone.model)
    named = trials.after[name]
    return _Decided(replace(verdict, named=named.hypothesis), named, alone, pairs, trials.replayed)


def _untestable(data: Gathered, train: Gathered) -> str:
    stuck = [f"recording {k}: {s.ending}" for k, s in enumerate(data.states) if len(s.x) < len(data.recordings[k])]
    if len(train.windows) < FEWEST_WINDOWS:
        return "; ".join(stuck) or f"{len(train.windows)} windows of a fifth of a second are too few, {FEWEST_WINDOWS} are needed"
    return ""


def _concluded(screened: Screened, decided: _Decided, train: Gathered, kept: Gathered | None, run: Map) -> Diagnosis:
    base, verdict, named = screened.base, decided.verdict, decided.named
    held = kept is not None and bool(kept.windows)
    floor = floor_mm(screened.evidence, train.recordings)
    before, after = list(screened.evidence), list(named.evidence)
    if held:
        before = _on_kept(base.model, kept, base.prior, run)
        after = before if verdict.named is None else _on_kept(corrected_model(named), kept, base.prior, run)
        if decided.alone is not None and decided.alone.windows is not None:
            one = _on_kept(corrected_model(decided.alone), kept, base.prior, run)
            if not shrinkage(one, after, floor_mm=floor, held_out=True).shrinks:
                verdict, named, after = first_alone(verdict, decided.alone.hypothesis), decided.alone, one
    gap = shrinkage(before, after, floor_mm=floor, held_out=held)
    if verdict.named is not None and held and not gap.shrinks:
        seen = "the gap hardly shrinks" if np.isfinite(gap.after_mm) else "it cannot be simulated"
        reason = f"{verdict.named.name} leads, but on motion kept out of the fit {seen}"
        verdict, after, gap = withdrawn(verdict, reason), before, unchanged(gap)
    fps = base.model.subject.fps
    accel = effect_acceleration(named.evidence, verdict.named, fps) if verdict.named else residual_acceleration(screened.evidence, fps)
    final = corrected_model(named) if verdict.named is not None and comes_nearer(named, decided.replayed) else base.model
    r = [np.concatenate([e.residual for e in evidence if e.residual is not None]) for evidence in (before, after)]
    return Diagnosis(
        verdict,
        gap,
        *r,
        base.model.subject.zone,
        accel,
        _by_frame(screened.evidence, train),
        ratios(screened),
        base.model,
        final,
        screened,
        decided.pairs,
        decided.replayed,
    )


def _on_kept(model: Model, kept: Gathered, prior: Prior, run: Map) -> list[Evidence]:
    """Windows kept out, simulated by a model from the start states that its body allows."""
    φ = smooth_modes(model.subject.cloth, MODES)
    return list(run(follow_corrected, jobs(model, restarted(model, kept, run), φ, prior=prior)))


def ratios(screened: Screened) -> dict[str, dict[str, Any]]:
    """κ_s/ρ and κ_b/ρ [m³/kg] of the refitted base, 90 % intervals by the jackknife over windows."""
    fabric, sd = screened.base.model.subject.fabric, np.sqrt(np.maximum(np.diag(screened.windows.base.base_covariance), 0))
    found = {}
    for name, value, s in zip(("kappa_s_over_rho", "kappa_b_over_rho"), (fabric.membrane, fabric.bending), sd, strict=True):
        ratio = value / fabric.density
        found[name] = {"value": ratio, "low": ratio * np.exp(-1.645 * s), "high": ratio * np.exp(1.645 * s), "unit": "m3/kg"}
    return found


def _by_frame(evidence: Sequence[Evidence], train: Gathered) -> Array:
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
