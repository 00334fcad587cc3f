"""What leads is put to motion kept out of every fit. What does not help there loses its name, and the next one is put to it, if it is
likelier than that nothing, or nothing in the library, is the cause. Where motion kept out is at its floor already nothing can shrink there;
then it is so many more windows, and all causes are weighed once more with them among those that teach.

At most `CHANCES` names are: of many, one would pass by chance.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.shooting import Evidence, follow_corrected
from tasks.cloth.state_modes import smooth_modes
from tasks.effects.model import Model
from tasks.gap.gathered import Gathered, jobs, restarted
from tasks.gap.held_out import Shrinkage, fallen, floor_mm, shrinkage, unchanged
from tasks.gap.hypotheses import Fitted
from tasks.gap.refits import Refitted, corrected_model
from tasks.gap.replay import Replay, base_replays, mean, parted, replayed_by
from tasks.gap.screening import MODES, signatures
from tasks.gap.trials import Trials
from tasks.gap.verdict import Verdict, abstained, first_alone, judge, nothing_needed

Array = NDArray[np.float64]

CHANCES = 3


@dataclass(frozen=True)
class Decided:
    """What the training windows say: the verdict, what it names as simulated last, the first of two named causes simulated alone, the pairs
    that were weighed.
    """

    verdict: Verdict
    named: Refitted | None
    alone: Refitted | None
    pairs: tuple[Fitted, ...]


@dataclass(frozen=True)
class Confirmed:
    """The verdict that motion kept out leaves, what it names; before, after: windows kept out with the base and with what is named (those
    of the training where nothing is kept out); gap: how these compare; pairs that were weighed beside the first leader.
    """

    verdict: Verdict
    named: Refitted | None
    before: Sequence[Evidence]
    after: Sequence[Evidence]
    gap: Shrinkage
    pairs: tuple[Fitted, ...]


def decided(trials: Trials) -> Decided:
    """Judged until what is named has been simulated."""
    while True:
        verdict, pairs = _judged(trials)
        if verdict.named is None:
            return Decided(verdict, None, None, pairs)
        name, own = verdict.named.name, verdict.named.effects
        alone = trials.after[own[0].name] if len(own) == 2 else None
        if name in trials.after:
            named = trials.after[name]
            return Decided(replace(verdict, named=named.hypothesis), named, alone, pairs)
        trials.after[name] = trials.simulate(verdict.named, alone and alone.model)


def _judged(trials: Trials) -> tuple[Verdict, tuple[Fitted, ...]]:
    pairs, missing = trials.pairs(), trials.replayed.something_missing
    doubt = trials.doubt(pairs)
    return judge(trials.singles, pairs, unexplained=doubt, missing=missing, cosines=trials.cosines, vetoed=trials.vetoed), pairs


def confirmed(trials: Trials, first: Decided, kept: Gathered | None, *, apart: bool) -> Confirmed:
    """What is left of a verdict on windows kept out. kept: None, or without windows that the base can follow, where there are none: the
    verdict stands, and no claim is made.

    apart: they are of other recordings than those of the training.
    """
    screened = trials.screened
    floor = floor_mm(screened.evidence, trials.train.recordings)
    test = _Test(trials, kept, floor, apart=apart) if kept is not None and kept.windows else None
    if test is None or not any(e.prediction.complete for e in test.before):
        after = screened.evidence if first.named is None else first.named.evidence
        gap = shrinkage(screened.evidence, after, floor_mm=floor, held_out=False, prior=screened.prior)
        return Confirmed(first.verdict, first.named, screened.evidence, after, gap, first.pairs)
    now, reasons = first, []
    while now.named is not None:
        now, after = test.of_second(now, test.evidence(now.named))
        gap = test.said(now.named, after)
        weighed = test.weighed_once_more(now) if gap.at_floor else now
        if weighed.named is not now.named and weighed.named is not None:
            now = weighed  # the first alone, of which nothing was asked yet
            continue
        if weighed.named is not None and (gap.at_floor or gap.shrinks):
            return Confirmed(_because(reasons, weighed.verdict), now.named, test.before, after, gap, first.pairs)
        reasons.append(_reason(now, gap))
        if gap.at_floor:
            now = weighed
            break
        trials.veto(now.verdict.named.effects)
        now = decided(trials) if len(reasons) < CHANCES else Decided(abstained(_judged(trials)[0]), None, None, ())
    return Confirmed(_because(reasons, now.verdict), None, test.before, test.before, unchanged(test.gap(test.before)), first.pairs)


def _because(reasons: Sequence[str], verdict: Verdict) -> Verdict:
    return replace(verdict, reason="; next, ".join(reasons))


def _reason(now: Decided, gap: Shrinkage) -> str:
    seen = "there is nothing to close" if gap.closed_fraction is None else "the gap hardly shrinks"
    if gap.leaves_floor:
        seen = f"it raises the gap from {gap.before_mm:.1f} to {gap.after_mm:.1f} mm, off its floor"
    if not np.isfinite(gap.after_mm):
        seen = "it cannot be simulated"
    return f"{now.verdict.named.name} leads, but on motion kept out of the fit {seen}"


class _Test:
    """Windows kept out; what the base makes of them."""

    def __init__(self, trials: Trials, kept: Gathered, floor: float, *, apart: bool) -> None:
        self.trials, self.kept, self.floor, self.apart = trials, kept, floor, apart
        self.before = self._followed(trials.screened.base.model)

    def evidence(self, named: Refitted) -> list[Evidence]:
        """What a refit makes of them."""
        return self._followed(corrected_model(named))

    def gap(self, after: Sequence[Evidence]) -> Shrinkage:
        """How the gap shrinks from the base's."""
        return shrinkage(self.before, after, floor_mm=self.floor, held_out=True, prior=self.trials.screened.base.prior)

    def said(self, named: Refitted, after: Sequence[Evidence]) -> Shrinkage:
        """The same, or how it shrinks in whole recordings replayed: where it shrinks there only, for of what acts slowly windows see
        little, and where windows have nothing to close, but replays have.
        """
        return _windows_or_replays(self.gap(after), lambda: self.replayed(named))

    def replayed(self, named: Refitted, beside: Refitted | None = None) -> Shrinkage | None:
        """How replays compare with the base's, or with those of a model beside which it stands, in the windows kept out that they pass
        through; None where there are none, or a replay cannot be finished.

        There is something to close where they are off by more than log ratio² scatters where nothing is missing. Where what is named moves
        them by no more than they part by chance, the gap counts as unchanged, for it might have fallen for anything, and they must be off
        by twice as much to speak at all: a replay that a cause hardly touches is a poor witness against it.
        """
        base, found = self._base_replays if beside is None else self._replays_of(beside), self._replays_of(named)
        before, after = _by_recording(base), _by_recording(found)
        boundary, rows = self.trials.screened.base.model.subject.cloth.boundary, []
        for w in self.kept.windows:
            b, a = before.get(w.recording), after.get(w.recording)
            if b is not None and a is not None and b.holds(w):
                rows.append(_over_floors(*(x.within(self.kept.recordings[w.recording], w, boundary) for x in (b, a))))
        if not rows:
            return None
        E = np.array(rows)
        floor = float(np.sqrt(E[:, 3].sum() / E[:, 2].sum()))
        off = mean(base)
        moved = parted(found, base) > off.chance
        gap = fallen(E[:, :3], floor, held_out=True, replayed=True, closable=np.exp(off.spread if moved else 2 * off.spread))
        return gap if moved else unchanged(gap)

    @cached_property
    def _base_replays(self) -> Sequence[Replay | None]:
        """Those of the training, or of the recordings held out apart."""
        trials = self.trials
        return base_replays(trials.base, (), self.kept, trials.run) if self.apart else trials.replays

    def _replays_of(self, named: Refitted) -> Sequence[Replay | None]:
        return replayed_by(corrected_model(named), self._base_replays, self.kept, self.trials.run) if self.apart else named.replays

    def of_second(self, now: Decided, after: list[Evidence]) -> tuple[Decided, list[Evidence]]:
        """Of two named causes the first, where the second does not help beside it."""
        alone = now.alone
        if alone is None or alone.windows is None:
            return now, after
        one = self.evidence(alone)
        inside = shrinkage(one, after, floor_mm=self.floor, held_out=True, prior=self.trials.screened.base.prior)
        if _windows_or_replays(inside, lambda: self.replayed(now.named, alone)).shrinks:
            return now, after
        return replace(now, verdict=first_alone(now.verdict, alone.hypothesis), named=alone, alone=None), one

    def weighed_once_more(self, now: Decided) -> Decided:
        """Single causes weighed by windows kept out too, and so whatever holds them: the same is named if it still leads, of two the first
        alone if that leads, or leads with a second that motion kept out was not asked about; else "none".
        """
        trials, first = self.trials, now.alone or now.named
        trials.learn(self.kept, self._signatures)
        verdict, _ = _judged(trials)
        leads, said = verdict.named, now.verdict.named
        if leads is None or leads.effects[0] != first.hypothesis.effects[0]:
            return Decided(nothing_needed(verdict), None, None, ())
        if leads.effects == said.effects:
            return replace(now, verdict=replace(verdict, named=said))
        alone = first_alone(verdict, first.hypothesis) if len(leads.effects) == 2 else replace(verdict, named=first.hypothesis)
        return Decided(alone, first, None, now.pairs)

    @cached_property
    def _signatures(self) -> tuple[Evidence, ...]:
        """Of the windows that the base can follow, with the tangents of all effects."""
        trials, followed = self.trials, [e for e in self.before if e.prediction.complete]
        kept = self.kept.only(e.prediction.window for e in followed)
        return signatures(trials.screened.base, kept, followed, trials.screened.windows.effects, trials.run, trials.tell)

    def _followed(self, model: Model) -> list[Evidence]:
        """Simulated from the start states that a model's body allows."""
        φ = smooth_modes(model.subject.cloth, MODES)
        run, prior = self.trials.run, self.trials.screened.base.prior
        return list(run(follow_corrected, jobs(model, restarted(model, self.kept, run, φ), φ, prior=prior)))


def _windows_or_replays(inside: Shrinkage, replayed: Callable[[], Shrinkage | None]) -> Shrinkage:
    """Which of the two speaks."""
    if inside.shrinks and not inside.at_floor:
        return inside
    whole = replayed()
    speaks = whole is not None and whole.closed_fraction is not None
    return whole if speaks and (inside.at_floor or whole.shrinks) else inside


def _over_floors(before: tuple[Array, Array], after: tuple[Array, Array]) -> list[float]:
    """Σ |r|²/F before and after, Σ 1/F [1/mm²] and how many vertices were seen, for residuals [L, V, 3] m with floors F [L] m²."""
    (b, floor), (a, _) = before, after
    F, seen = 1e6 * floor[:, None], np.isfinite(b).all(-1)
    return [*(float(np.nansum(1e6 * np.sum(r**2, -1) / F)) for r in (b, a)), float(np.sum(seen / F)), float(seen.sum())]


def _by_recording(replays: Sequence[Replay | None]) -> dict[int, Replay]:
    """Recordings of which no window was left have none."""
    return {r.window.recording: r for r in replays if r is not None}
