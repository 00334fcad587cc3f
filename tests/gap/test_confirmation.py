"""What leads is put to motion kept out: what does not help there is not named, and the next one is asked."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tasks.cloth.windows import Window
from tasks.gap import confirmation
from tasks.gap.confirmation import CHANCES, confirmed, decided
from tasks.gap.held_out import fallen
from tasks.gap.refits import Refitted
from tasks.gap.replay import Replay, Replayed
from tasks.gap.verdict import TEMPER
from tests.gap.test_held_out import PRIOR, evidence
from tests.gap.test_hypotheses import EFFECTS
from tests.gap.test_trials import Rehearsed

DRAG, DAMPING, FRICTION, HEM, TILT = (e.name for e in EFFECTS)
KEPT = SimpleNamespace(windows=[None])
FLOOR, BASE = 1.0, 10.0  # mm


@pytest.fixture
def put(monkeypatch):
    """Evidence of each effect on the training windows, mm of each hypothesis on windows kept out, `again`: evidence with these among the
    windows, `pair`: a second effect and its evidence, before and with them (then of another second, if one is named), and `whole`: how
    replays compare there -> what is confirmed, and the trials.
    """

    def run(weigh, mm, *, pair=None, doubt=0.0, alike=frozenset(), kept=KEPT, base=BASE, again=None, whole=None):
        t = Rehearsed(monkeypatch, doubt=doubt, finds=lambda name, origin: (0.3, weigh.get(name, -4.0)))
        t.screened.hypotheses = tuple(
            replace(h, weights=(replace(h.weights[0], likelihood=weigh.get(h.name, -4.0), prior=0.0),)) for h in t.screened.hypotheses
        )
        t.screened.prior, t.screened.evidence = PRIOR, _simulated(np.random.default_rng(0), base)
        t.screened.base = replace(t.screened.base, model="none", prior=PRIOR)
        t.alike, t.train = alike, SimpleNamespace(recordings=())
        t.windows = t.screened.evidence
        t.settle()
        taught = t.leader.evidence
        t.pairs = lambda: () if pair is None else _pairs(t, *_second(*pair, now=t.leader.evidence != taught))
        monkeypatch.setattr(confirmation, "floor_mm", lambda *_: FLOOR)
        monkeypatch.setattr(confirmation, "corrected_model", lambda named: named.hypothesis.name)
        rng = np.random.default_rng(1)
        monkeypatch.setattr(confirmation._Test, "_followed", lambda self, model: _simulated(rng, mm.get(model, base)))
        monkeypatch.setattr(confirmation._Test, "_signatures", ())
        t.learn = lambda *_: t.after.update({n: _weighing(t.after[n], e) for n, e in (again or weigh).items() if n in t.after})
        monkeypatch.setattr(confirmation._Test, "replayed", lambda self, named, beside=None: (whole or {}).get(named.hypothesis.name))
        return confirmed(t, decided(t), kept, apart=False), t

    return run


def _simulated(rng, mm):
    if mm is None:
        return [replace(e, prediction=replace(e.prediction, ending="stalled"), residual=None) for e in evidence(rng, 1.0)]
    return evidence(rng, mm)


def _weighing(named, evidence):
    (weight,) = named.hypothesis.weights
    return replace(named, hypothesis=replace(named.hypothesis, weights=(replace(weight, likelihood=evidence, prior=0.0),)))


def _second(name, before, after=None, other=None, *, now):
    return (other or name, before if after is None else after) if now else (name, before)


def _pairs(trials, second, gain):
    """One second effect beside the leader."""
    leader, other = trials.leader, next(h for h in trials.screened.hypotheses if h.name == second)
    weights = (*leader.weights, replace(other.weights[0], likelihood=gain, prior=0.0))
    return (replace(leader, effects=(*leader.effects, *other.effects), strengths={**leader.strengths, **other.strengths}, weights=weights),)


def test_what_helps_there_keeps_its_name(put):
    found, _ = put({FRICTION: 20.0}, {FRICTION: 3.0})
    assert found.verdict.classes == ((FRICTION,),) and found.verdict.reason == ""
    assert found.gap.after_mm == pytest.approx(3.0, rel=0.05) and found.named.hypothesis is found.verdict.named


def test_the_next_one_is_asked_where_it_is_likelier_than_nothing(put):
    found, trials = put({FRICTION: 20.0, DRAG: 14.0}, {FRICTION: 9.9, DRAG: 3.0})
    assert found.verdict.classes == ((DRAG,),)
    assert found.verdict.reason == f"{FRICTION} leads, but on motion kept out of the fit the gap hardly shrinks"
    assert found.gap.after_mm == pytest.approx(3.0, rel=0.05) and found.named.hypothesis.name == DRAG
    assert trials.asked[-1][0] == DRAG  # what is named has been simulated
    assert sum(c.probability for c in found.verdict.ranking) == pytest.approx(1)


def test_and_is_not_where_nothing_is_likelier(put):
    found, _ = put({FRICTION: 20.0, DRAG: -2.0}, {FRICTION: 9.9, DRAG: 3.0})
    assert found.verdict.kind in ("none", "outside_library") and found.named is None
    assert found.gap.after_mm == found.gap.before_mm


def test_of_what_forms_a_class_with_it_the_others_are_asked(put):
    before, _ = put({FRICTION: 20.0, DRAG: 19.0}, {}, kept=None)
    assert before.verdict.classes == ((FRICTION, DRAG),)
    after, trials = put({FRICTION: 20.0, DRAG: 19.0}, {DRAG: 3.0})
    assert {FRICTION} == trials.vetoed and after.verdict.classes == ((DRAG,),)
    assert _of(after.verdict, FRICTION) == pytest.approx(0.01 * _of(after.verdict, "none") / len(EFFECTS), rel=0.02)


def test_motion_kept_out_that_the_base_cannot_follow_says_nothing(put):
    """It had vetoed three names in turn, and the diagnosis then had no window to show."""
    found, trials = put({FRICTION: 20.0}, {"none": None, FRICTION: None})
    assert found.verdict.classes == ((FRICTION,),) and not trials.vetoed
    assert not found.gap.held_out and found.before is trials.screened.evidence and found.after is found.named.evidence


def test_motion_that_is_at_its_floor_weighs_once_more_what_leads(put):
    """Among the windows that teach; what still leads stays named, as strong as it was."""
    before, _ = put({FRICTION: 20.0}, {}, kept=None)
    after, trials = put({FRICTION: 20.0}, {FRICTION: 1.01}, base=1.0, again={FRICTION: 6.0})
    assert after.verdict.classes == ((FRICTION,),) and not trials.vetoed and after.gap.closed_fraction is None and after.gap.after_mm > 1.0
    assert after.verdict.named is after.named.hypothesis and after.named.hypothesis.evidence == 20.0
    odds = [_of(v, FRICTION) / _of(v, "none") for v in (before.verdict, after.verdict)]
    assert odds[1] / odds[0] == pytest.approx(np.exp(TEMPER * (6.0 - 20.0)), rel=1e-6)
    assert sum(c.probability for c in after.verdict.ranking) == pytest.approx(1) and after.verdict.probability == _of(
        after.verdict, FRICTION
    )


def test_what_lifts_motion_kept_out_off_its_floor_is_not_named_however_likely(put):
    """A curtain in drag, at its floor, went from 7.8 to 8.3 mm (floor 7.2) with a hysteresis that was named with 0.97."""
    found, trials = put({FRICTION: 20.0, DRAG: 14.0}, {FRICTION: 1.2, DRAG: 1.01}, base=1.05, again={FRICTION: 20.0, DRAG: 14.0})
    assert found.verdict.classes == ((DRAG,),) and trials.vetoed == {FRICTION}
    assert found.verdict.reason.startswith(f"{FRICTION} leads, but on motion kept out of the fit it raises the gap from 1.")
    assert found.verdict.reason.endswith(" mm, off its floor")


def test_unless_whole_recordings_shrink_with_it(put):
    found, _ = put({FRICTION: 20.0}, {FRICTION: 1.2}, base=1.05, again={FRICTION: 20.0}, whole={FRICTION: replays(30.0, 6.0, 5.0)})
    assert found.verdict.classes == ((FRICTION,),) and found.gap.replayed


def test_doubt_beside_a_cause_shrinks_with_its_weight(put):
    """What is outside the library weighs a share of what is named: named once and weighed down later, that share had led in its stead (0.67)."""
    after, _ = put({FRICTION: 20.0}, {FRICTION: 1.01}, base=1.0, doubt=0.9, again={FRICTION: 8.0})
    assert after.verdict.classes == ((FRICTION,),) and _of(after.verdict, "outside_library") < 0.3


def test_at_its_floor_motion_that_leaves_a_cause_too_little_says_none(put):
    """Though outside the library be likelier: there is nothing to explain."""
    found, trials = put({FRICTION: 20.0}, {FRICTION: 1.01}, base=1.0, doubt=0.9, again={FRICTION: -3.0})
    assert found.verdict.ranking[0].names == ("outside_library",)
    assert found.verdict.kind == "none" and found.named is None and not trials.vetoed
    assert found.verdict.reason == f"{FRICTION} leads, but on motion kept out of the fit there is nothing to close"
    assert _of(found.verdict, "none") == found.verdict.probability


def test_a_pair_that_only_windows_kept_out_make_lead_leaves_the_first_its_name(put):
    """It was not asked whether the second helps there."""
    found, _ = put({FRICTION: 20.0, DRAG: 1.0}, {FRICTION: 1.01}, base=1.0, again={FRICTION: 19.0}, pair=(DRAG, 3.0, 9.0))
    assert found.verdict.classes == ((FRICTION,),) and found.verdict.named is found.named.hypothesis
    assert found.verdict.ranking[0].fitted is found.verdict.named and found.verdict.probability > 0.95  # what both weighed


def test_at_its_floor_what_is_named_is_told_with_the_class_that_it_has_now(put):
    """A name of 98 % had stood beside a class of two that had weighed them."""
    found, _ = put({FRICTION: 20.0, DRAG: 5.5}, {FRICTION: 1.01}, base=1.01, again={FRICTION: 6.0})
    assert found.verdict.classes == ((FRICTION, DRAG),) == (found.verdict.ranking[0].names,)
    assert found.verdict.probability == found.verdict.ranking[0].probability


@pytest.mark.parametrize(("beside", "named"), [(9.0, (FRICTION, DAMPING)), (4.0, (FRICTION,))])
def test_at_its_floor_two_causes_keep_their_names_only_if_both_still_lead(put, beside, named):
    """Else the first is named, as simulated by itself; the pair had been named with what the first alone weighs."""
    both = f"{FRICTION} + {DAMPING}"
    mm = {FRICTION: 1.01, both: 1.0}
    found, trials = put({FRICTION: 20.0, DRAG: 5.5}, mm, base=1.01, again={FRICTION: 6.0}, pair=(DAMPING, 9.0, beside))
    v, named_ = found.verdict, found.named.hypothesis
    assert tuple(e.name for e in v.named.effects) == tuple(e.name for e in named_.effects) == named
    assert v.probability == v.ranking[0].probability and len(v.classes) == len(named) and not trials.vetoed
    assert found.gap.after_mm == pytest.approx(1.0 if len(named) == 2 else 1.01, rel=0.01)
    assert v.ranking[0].names == tuple(dict.fromkeys(n for c in v.classes for n in c))


def test_and_the_first_where_another_pair_leads(put):
    """It was not asked whether that second helps there."""
    mm = {FRICTION: 1.01, f"{FRICTION} + {DAMPING}": 1.0}
    found, _ = put({FRICTION: 20.0}, mm, base=1.01, again={FRICTION: 19.0}, pair=(DAMPING, 9.0, 9.0, DRAG))
    assert found.verdict.classes == ((FRICTION,),) and found.verdict.named is found.named.hypothesis


def _of(verdict, name):
    return next(c.probability for c in verdict.ranking if name in c.names)


def replays(before, after, floor):
    return fallen(np.array([[before**2, after**2, 1.0]] * 3), floor, held_out=True, replayed=True)


@pytest.mark.parametrize("base", [1.0, 10.0])
def test_what_windows_do_not_show_replays_may(put, base):
    slow = {FRICTION: replays(30.0, 6.0, 5.0)}
    found, _ = put({FRICTION: 20.0}, {FRICTION: 1.05 * base}, base=base, whole=slow)
    assert found.verdict.classes == ((FRICTION,),) and found.gap is slow[FRICTION] and found.gap.replayed
    for says_nothing in (replays(5.2, 1.0, 5.0), None):
        found, _ = put({FRICTION: 20.0}, {FRICTION: 1.05 * base}, base=base, again={FRICTION: -3.0}, whole={FRICTION: says_nothing})
        assert found.named is None and not found.gap.replayed


@pytest.mark.parametrize("base", [1.0, 10.0])
def test_what_helps_in_neither_loses_its_name(put, base):
    found, trials = put({FRICTION: 20.0}, {FRICTION: 1.05 * base}, base=base, whole={FRICTION: replays(30.0, 29.0, 5.0)})
    assert found.named is None and trials.vetoed == {FRICTION} and found.verdict.reason.endswith("the gap hardly shrinks")


def test_replays_are_compared_in_windows_kept_out_of_the_recording_they_are_of():
    """The first recording has no window that teaches: the only replay is the second's."""
    V, boundary = 3, np.array([0])
    still, nudged, moved = (np.full((9, V, 3), d) for d in (0.0, 1e-3, 3e-3))  # 5.2, 3.5 and 0 mm off

    def of(x):
        return (Replay(Replayed(1.0, 4e-6, chance=4e-6), Window(1, 2, 8), x, np.full(8, 4e-6), None),)

    recordings = tuple(SimpleNamespace(observed=np.full((12, V, 3), offset)) for offset in (1.0, 3e-3))
    kept = SimpleNamespace(windows=[Window(0, 4, 3), Window(1, 4, 3), Window(1, 8, 3)], recordings=recordings)
    cloth = SimpleNamespace(boundary=boundary)
    base = SimpleNamespace(model=SimpleNamespace(subject=SimpleNamespace(cloth=cloth)), prior=None)
    trials = SimpleNamespace(screened=SimpleNamespace(base=base), replays=of(still), run=map)
    test = confirmation._Test.__new__(confirmation._Test)
    test.trials, test.kept, test.apart = trials, kept, False
    gap = test.replayed(SimpleNamespace(replays=of(moved)))
    assert gap.before_mm == pytest.approx(3 * 3**0.5) and gap.after_mm == 0.0 and gap.floor_mm == pytest.approx(2.0)
    assert test.replayed(SimpleNamespace(replays=(None,))) is None
    by_chance = test.replayed(SimpleNamespace(replays=of(nudged)))  # no farther from the base's than replays that start otherwise
    assert gap.shrinks and not by_chance.shrinks and by_chance.after_mm == gap.before_mm and by_chance.closed_fraction == 0.0
    beside = test.replayed(SimpleNamespace(replays=of(moved)), SimpleNamespace(replays=of(nudged)))
    assert beside.before_mm == pytest.approx(2 * 3**0.5) and beside.after_mm == 0.0 and beside.shrinks
    one = np.exp(0.5 * of(still)[0].replayed.spread)  # floors, a standard deviation of where nothing is missing
    for x, off, closable in (
        (moved, 0.98 * one, False),
        (moved, 1.02 * one, True),
        (nudged, 0.98 * one**2, False),
        (nudged, 1.02 * one**2, True),
    ):
        recordings[1].observed[:] = off * 2e-3 / 3**0.5
        assert (test.replayed(SimpleNamespace(replays=of(x))).closed_fraction is not None) is closable


def test_where_windows_show_it_they_are_what_is_told(put):
    found, _ = put({FRICTION: 20.0}, {FRICTION: 3.0}, whole={FRICTION: replays(30.0, 6.0, 5.0)})
    assert found.gap.after_mm == pytest.approx(3.0, rel=0.05) and not found.gap.replayed


def test_of_many_names_only_a_few_are_put_to_it(put):
    weigh = {FRICTION: 30.0, DRAG: 25.0, DAMPING: 20.0, HEM: 15.0}
    found, trials = put(weigh, {HEM: 3.0})
    assert found.verdict.kind == "none" and len(trials.vetoed) == CHANCES
    assert found.verdict.reason.count("leads") == CHANCES
    assert HEM not in {name for name, _ in trials.asked}  # what cannot be named any more is not simulated
    assert _of(found.verdict, HEM) > 0.9  # said as it is
    found, _ = put(weigh, {DAMPING: 3.0})
    assert found.verdict.classes == ((DAMPING,),)


def test_twins_of_what_does_not_help_are_not_asked(put):
    found, trials = put({FRICTION: 20.0, DRAG: 19.0}, {DRAG: 3.0}, alike=frozenset({frozenset((FRICTION, DRAG))}))
    assert found.verdict.kind == "none" and trials.vetoed == {FRICTION, DRAG}


@pytest.mark.parametrize(("together", "names"), [(3.0, {FRICTION, DRAG}), (5.0, {FRICTION})])
def test_a_second_cause_stays_only_if_it_helps_beside_the_first(put, together, names):
    found, _ = put({FRICTION: 20.0}, {FRICTION: 5.0, f"{FRICTION} + {DRAG}": together}, pair=(DRAG, 10.0))
    assert {n for c in found.verdict.classes for n in c} == names
    assert found.gap.after_mm == pytest.approx(together, rel=0.05)


def test_what_cannot_be_simulated_there_says_so(put):
    found, _ = put({FRICTION: 20.0}, {FRICTION: None})
    assert found.verdict.named is None
    assert found.verdict.reason.endswith("it cannot be simulated")


def test_without_motion_kept_out_no_claim_is_made(put):
    found, trials = put({FRICTION: 20.0}, {}, kept=SimpleNamespace(windows=[]))
    assert found.verdict.classes == ((FRICTION,),) and not found.gap.held_out and not trials.vetoed
    assert isinstance(found.named, Refitted)
