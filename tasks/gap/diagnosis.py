"""The diagnosis, from recordings of one garment to where the base model fails, which effect it lacks, and how far the gap then shrinks.

    states → base refit → the same computed otherwise → tangents of all effects → hypotheses → refit of the leaders → verdict → held-out windows

Where the leader's fabric leads to a nearer base, all from the base refit on is done once more about that (`nested_base.py`).

Windows are as long as the cloth can be predicted (`window_length.py`).

What is fitted and weighed before the verdict are training windows alone. Start states are smoothed over all frames, and the first rounds of
the base refit, in windows of other lengths, may have seen frames that are kept out later; a recording that is held out apart is not asked
for before the verdict.

`run` maps a function over windows: serially, over processes, or over workers.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.base_parameters import moved
from tasks.cloth.shooting import Evidence, Map
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.tracking_noise import Correlation
from tasks.cloth.windows import Recording, Window
from tasks.effects.effect import Effect
from tasks.effects.model import Model
from tasks.gap.acceleration import effect_acceleration, residual_acceleration
from tasks.gap.confirmation import Confirmed, confirmed, decided
from tasks.gap.gathered import FEWEST_WINDOWS, Gathered, gather, lengths, restarted, restated, unwrinkled
from tasks.gap.held_out import Shrinkage, floor_mm
from tasks.gap.hypotheses import Fitted
from tasks.gap.next_recording import Design, designs, in_question
from tasks.gap.refits import Refitted, comes_nearer, corrected_model
from tasks.gap.replay import Replayed
from tasks.gap.screening import MODES, Screened, roughly_refitted
from tasks.gap.trials import Trials
from tasks.gap.verdict import Candidate, Verdict
from tasks.gap.window_length import Look, Looked

Array = NDArray[np.float64]

RATIOS = ("kappa_s_over_rho", "kappa_b_over_rho")


@dataclass(frozen=True)
class Diagnosis:
    """The answer and what it rests on.

    before, after [n, V, 3] m: residuals of the frames of the windows `compared`, NaN where not seen; zone [V]; residual_accel [V] m/s²:
    what is missing in the training windows; added [V] m/s²: by what is named, None where nothing is, or nothing that acts on cloth;
    frame_mm [T] of the first recording; parameters: ratios of stiffness to density with intervals, None where nothing is known; pairs: second effects that were weighed
    beside the leading one; base, replayed: the base that comes nearest to whole recordings, and how near; floor_mm: of a window. named: the
    model for motions not seen: with the named effect, unless whole recordings replayed with it came less near than the base's. designs:
    motions to record next, where causes are left that these recordings do not tell apart.
    """

    verdict: Verdict
    shrinkage: Shrinkage
    before: Array
    after: Array
    zone: NDArray[np.str_]
    residual_accel: Array
    added: Array | None
    frame_mm: Array
    parameters: dict[str, dict[str, Any]]
    base: Model
    named: Model
    screened: Screened | None
    compared: tuple[Window, ...] = ()
    pairs: tuple[Fitted, ...] = ()
    replayed: Replayed | None = None
    floor_mm: float = np.nan
    designs: tuple[Design, ...] = ()

    @property
    def vertex_accel(self) -> Array:
        """Missing acceleration [V] m/s², of what is named if that acts on cloth."""
        return self.residual_accel if self.added is None else self.added


def diagnose(
    model: Model,
    recordings: Sequence[Recording],
    effects: Sequence[Effect],
    *,
    contact_doubt: float = 0.0,
    held_out: Callable[[], Sequence[Recording]] | None = None,
    quick: bool = False,
    run: Map = map,
    abreast: int = 1,
    tell: Callable[[str], None] = lambda text: None,
) -> Diagnosis:
    """The whole diagnosis of one garment. `held_out` is called, and its recordings first read, when the verdict is fixed; where
    there are none, no claim on motion kept out is made.

    contact_doubt [m]: where contact may hold the cloth wrongly because the mesh is coarse. abreast: threads that may ask `run` at a time.
    """
    tell("states")
    data = gather(model, recordings, run)
    first, fps, apart = model, model.subject.fps, held_out is not None
    φ = smooth_modes(model.subject.cloth, MODES)
    look = Look(effects, contact_doubt, φ, apart, run, tell)
    train, _ = look.taught(data)
    doubt = _untestable(data, train)
    if doubt:
        return _unanswered(model, recordings, doubt)
    longest_first = lengths(recordings, fps)
    first_rounds = longest_first[-1:] if quick else longest_first[::-1]
    each = [look.taught(data.cut(length_s, fps))[0] for length_s in first_rounds]
    model, correlation = roughly_refitted(model, each, run, tell, searched=not quick)
    data = restated(model, data.correlated(correlation), run)
    looked = look.longest_predicted(model, data, longest_first, quick=quick)

    def settled(looked: Looked) -> Trials:
        trials = Trials(looked.screened, first, looked.train, effects, run, tell, quick=quick, abreast=abreast)
        trials.settle()
        return trials

    if (followed := len(looked.screened.evidence)) < FEWEST_WINDOWS:
        return _unanswered(looked.screened.base.model, recordings, f"the simulation can follow only {followed} windows of the recording")
    trials = settled(looked)
    if (other := trials.nested_base()) is not None:
        again = look.at(other, restated(other, looked.data, run), looked.length_s)
        if len(again.screened.evidence) >= FEWEST_WINDOWS:
            looked, trials = again, settled(again)
    verdict = decided(trials)
    tell("held-out windows")
    kept = looked.held
    if held_out is not None:
        further = held_out()
        kept = _kept_apart(looked.screened.base.model, further, correlation, looked.length_s, φ, run) if further else None
    return _concluded(trials, confirmed(trials, verdict, kept, apart=apart), looked.train)


def _kept_apart(model: Model, recordings: Sequence[Recording], correlation: Correlation, length_s: float, φ: Array, run: Map) -> Gathered:
    """Windows of recordings held out."""
    return unwrinkled(model, gather(model, recordings, run).correlated(correlation).cut(length_s, model.subject.fps), φ, run)


def _untestable(data: Gathered, train: Gathered) -> str:
    stuck = [f"recording {k}: {s.ending}" for k, s in enumerate(data.states) if len(s.x) < len(data.recordings[k])]
    if len(train.windows) < FEWEST_WINDOWS:
        return "; ".join(stuck) or f"{len(train.windows)} windows of a fifth of a second are too few, {FEWEST_WINDOWS} are needed"
    return ""


def _concluded(trials: Trials, found: Confirmed, train: Gathered) -> Diagnosis:
    screened, verdict = trials.screened, found.verdict
    model, fps = screened.base.model, screened.base.model.subject.fps
    named = found.named
    final = trials.base if named is None or not comes_nearer(named, trials.replayed) else corrected_model(named)
    before, after = (np.concatenate([e.residual for e in each if e.residual is not None]) for each in (found.before, found.after))
    frame_mm = _by_frame(screened.evidence, train)
    return Diagnosis(
        verdict,
        found.gap,
        before,
        after,
        model.subject.zone,
        residual_acceleration(screened.evidence, fps),
        None if named is None else _added(trials, named),
        frame_mm,
        ratios(screened),
        trials.base,
        final,
        screened,
        tuple(e.prediction.window for e in found.before if e.residual is not None),
        found.pairs,
        trials.replayed,
        floor_mm(screened.evidence, train.recordings),
        _designs(trials, verdict),
    )


def _designs(trials: Trials, verdict: Verdict) -> tuple[Design, ...]:
    """None of a quick diagnosis."""
    if trials.quick:
        return ()
    trials.tell("the next recording")
    asked = in_question(verdict, [h for h in trials.singles if h.weights])
    return designs(trials.screened, trials.base, trials.train, asked, or_none="none" in verdict.answer_set, run=trials.run)


def _added(trials: Trials, named: Refitted) -> Array | None:
    """[V] m/s² on the training windows, by those of the effects that do not only change what is seen; None without any."""
    model, acting = corrected_model(named), [e for e in named.hypothesis.effects if "observe" not in e.acts_through]
    strengths = {c: named.hypothesis.strengths[c] for e in acting for c in e.columns}
    return effect_acceleration(model, restarted(model, trials.train, trials.run), strengths, trials.run) if acting else None


def ratios(screened: Screened) -> dict[str, dict[str, Any]]:
    """κ_s/ρ and κ_b/ρ [m³/kg] of the base, at what its windows ask for beside numerics; 90 % intervals, Student's, of their logarithms."""
    base = screened.windows.base
    fabric = moved(screened.base.model.subject.fabric, base.base)[0]
    factors = np.exp(base.quantile(0.95) * np.sqrt(np.maximum(np.diag(base.base_covariance), 0)))
    found = {}
    for name, value, factor in zip(RATIOS, (fabric.membrane, fabric.bending), factors, strict=True):
        ratio = value / fabric.density
        found[name] = _ratio(ratio, ratio / factor, ratio * factor)
    return found


def _ratio(value: float | None, low: float | None, high: float | None) -> dict[str, Any]:
    return {"value": value, "low": low, "high": high, "unit": "m3/kg"}


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
    unknown = {name: _ratio(None, None, None) for name in RATIOS}
    return Diagnosis(
        verdict, gap, nothing, nothing, model.subject.zone, np.full(V, np.nan), None, np.full(T, np.nan), unknown, model, model, None
    )
