"""Which simulations the leading hypothesis gets: again while its strength moves, afresh where it leaves much."""

import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tasks.cloth.base_refit import BaseFit
from tasks.gap import trials
from tasks.gap.probes import Probe
from tasks.gap.refits import Refitted
from tasks.gap.trials import AGAIN, PROPOSED, Trials
from tasks.gap.verdict import TEMPER
from tests.gap.test_hypotheses import EFFECTS, windows

FRICTION = "contact_friction"


class Rehearsed(Trials):
    """Trials whose simulations are written down: what each finds follows from the fabric it starts at."""

    def __init__(self, monkeypatch, *, doubt, finds, quick=False, abreast=1):
        w = windows(np.random.default_rng(0), truth={FRICTION: 0.3})
        hypotheses = tuple(sorted((w.fit([e]) for e in EFFECTS), key=lambda h: -h.evidence))
        base = BaseFit(SimpleNamespace(name="base"), np.eye(2), None, (), (), "converged")
        self.screened = SimpleNamespace(hypotheses=hypotheses, base=base, evidence=())
        self.train, self.effects, self.run, self.tell, self.quick, self.abreast = None, EFFECTS, map, print, quick, abreast
        self.first = SimpleNamespace(name="first")
        self.alike, self.cosines, self.vetoed = frozenset(), None, frozenset()
        self.after, self.replays, self.replayed = {}, (), SimpleNamespace(something_missing=0.0)
        self.promised, self.proposed, self.probed, self.scaled, self._asked_afresh = {}, [], [], [], set()
        self.asked, self.finds, self.windows, self.seconds, self.learnt = [], finds, (), (), ()
        self.gains, self.beside = np.ones(20), []
        self.left, self.left_with_second = doubt, doubt
        monkeypatch.setattr(trials, "by_contact", lambda *_: [])
        monkeypatch.setattr(trials, "by_length", lambda *_: self.scaled)
        monkeypatch.setattr(trials, "afresh", lambda screened, first, train, hypothesis, run: (hypothesis, first))
        monkeypatch.setattr(trials, "probed", self._asked)
        fabric = SimpleNamespace(name="the leader's")
        corrected = SimpleNamespace(name="corrected", subject=SimpleNamespace(fabric=fabric))
        monkeypatch.setattr(trials, "corrected_model", lambda named: corrected)
        monkeypatch.setattr(trials, "restarted", lambda model, data, run: data)
        monkeypatch.setattr(trials, "at_rest", self._at_rest)

    def _asked(self, about, data, effects, alike, run):
        proposed = self.beside if getattr(about.model, "name", "") == "corrected" else self.proposed
        gains = zip((h.effects[-1] for h in proposed), self.gains, strict=False)
        return [Probe(e, e.typical, g) for e, g in gains if e in effects]

    def _at_rest(self, about, data, probe, run):
        self.probed.append(probe.effect.name)
        return SimpleNamespace(name=f"probed {about.model.name}", by_column=lambda effects: {c: 0.3 for e in effects for c in e.columns})

    def simulate(self, hypothesis, start=None):
        origin = getattr(start, "name", "base")
        self.asked.append((hypothesis.name, origin))
        strength, evidence = self.finds(hypothesis.name, origin)
        *others, weight = hypothesis.weights
        found = replace(
            hypothesis,
            strengths=dict.fromkeys(hypothesis.strengths, strength),
            weights=(*others, replace(weight, likelihood=evidence, prior=0.0)),
            base=np.zeros(2),
        )
        told, columns = {e.name: hypothesis.θ(e) for e in hypothesis.effects}, dict(hypothesis.strengths)
        model = SimpleNamespace(name=f"{origin}+", strength=lambda e: told[e.name], by_column=lambda effects: columns)
        return Refitted(found, model, self.windows, windows=())

    def foretold(self):
        return {
            h.name: (replace(h, strengths=dict.fromkeys(h.strengths, 7.0)), self.promised.get(h.name, 0.0))
            for h in self.screened.hypotheses
        }

    def doubt(self, pairs=()):
        return self.left_with_second if any(pair.name in self.after for pair in pairs) else self.left

    def pairs(self):
        return self.seconds


def test_contenders_may_be_simulated_side_by_side(monkeypatch):
    """Two are under way before either ends, and what comes of them is the same."""

    def settled(abreast):
        together, begun = threading.Barrier(abreast, timeout=20), set()

        def finds(name, origin):
            if name not in begun:
                begun.add(name)
                together.wait()
            return 0.3, 20.0 if name == FRICTION else 1.0

        t = Rehearsed(monkeypatch, doubt=0.0, finds=finds, abreast=abreast)
        monkeypatch.setattr(trials, "contenders", lambda singles, *_: list(singles)[:2])
        t.settle()
        return [(name, r.hypothesis.strengths, r.hypothesis.evidence) for name, r in t.after.items()]

    assert settled(2) == settled(1) and len(settled(1)) == 2


def restless():
    """What simulations find where friction leads and every one asks for half as much again."""
    strength = {}

    def finds(name, origin):
        strength[name] = strength.get(name, 0.3) * 1.5
        return strength[name], 20.0 if name == FRICTION else 1.0

    return finds


@pytest.mark.parametrize(("grows", "times"), [(1.0, 0), (1.02, 0), (1.5, AGAIN)])
def test_the_leader_is_simulated_again_while_its_strength_moves(monkeypatch, grows, times):
    strength = {FRICTION: 0.3}

    def finds(name, origin):
        strength[name] = strength.get(name, 0.3) * grows
        return strength[name], 20.0 if name == FRICTION else 1.0

    t = Rehearsed(monkeypatch, doubt=0.0, finds=finds)
    strength[FRICTION] = t.leader.strengths[FRICTION]
    t.settle()
    assert t.asked[0] == (FRICTION, "base")
    assert len(t.asked) == 1 + times
    assert all(origin == "base" + "+" * k for k, (_, origin) in enumerate(t.asked))


def test_what_was_simulated_stands_where_it_cannot_be_followed_further(monkeypatch):
    t = Rehearsed(monkeypatch, doubt=0.0, finds=restless())
    simulate = t.simulate
    monkeypatch.setattr(t, "simulate", lambda h, start=None: replace(simulate(h, start), windows=None if start else ()))
    t.settle()
    assert t.asked == [(FRICTION, "base"), (FRICTION, "base+")]
    assert t.after[FRICTION].model.name == "base+" and t.leader.evidence == 20.0


@pytest.mark.parametrize(("gains", "times"), [(0.0, 1), (2.0, AGAIN)])
def test_a_fabric_that_wanders_on_for_nothing_is_not_followed(monkeypatch, gains, times):
    """A smoothing tracker (open case) was simulated six times: it asked for another stiffness again and again, at the same evidence."""
    evidence = iter(20.0 + gains * np.arange(9))
    t = Rehearsed(monkeypatch, doubt=0.0, finds=lambda name, origin: (0.3, next(evidence) if name == FRICTION else 1.0))
    t.promised = {FRICTION: 20.0}
    at_rest = {h.name: (replace(h, strengths=dict.fromkeys(h.strengths, 0.3)), 20.0) for h in t.screened.hypotheses}
    monkeypatch.setattr(t, "foretold", lambda: at_rest)
    simulate = t.simulate

    def wandering(h, start=None):
        found = simulate(h, start)
        return replace(found, hypothesis=replace(found.hypothesis, base=np.array([0.6, 0.0])))

    monkeypatch.setattr(t, "simulate", wandering)
    t.settle()
    assert [name for name, _ in t.asked].count(FRICTION) == 1 + times


@pytest.mark.parametrize(("quick", "at_half", "stands"), [(False, 20.0, 3.0), (False, 5.0, 2.0), (True, 20.0, 2.0)])
def test_a_step_that_makes_it_weigh_less_is_halved_then_taken_back(monkeypatch, quick, at_half, stands):
    """Drag of a sealed case led at 8.0, asked for 11.5, weighed nothing there, and was given up. In a hurry nothing is simulated half-way."""
    asked = []

    def finds(name, origin):
        if name != FRICTION:
            return 0.3, 1.0
        return {2.0: (4.0, 20.0), 4.0: (4.0, 3.0), 3.0: (3.0, at_half)}[asked[-1]]

    t = Rehearsed(monkeypatch, doubt=0.0, finds=finds, quick=quick)
    at_two = {h.name: (replace(h, strengths=dict.fromkeys(h.strengths, 2.0)), 20.0) for h in t.screened.hypotheses}
    monkeypatch.setattr(t, "foretold", lambda: at_two)
    simulate = t.simulate
    monkeypatch.setattr(t, "simulate", lambda h, start=None: asked.append(h.strengths.get(FRICTION)) or simulate(h, start))
    t.settle()
    assert [θ for θ in asked if θ is not None] == ([2.0, 4.0] if quick else [2.0, 4.0, 3.0])
    assert t.leader.name == FRICTION and t.leader.strengths[FRICTION] == stands and t.leader.evidence == 20.0


@pytest.mark.parametrize("better", [True, False])
def test_where_it_leaves_much_it_starts_once_from_the_first_fabric_and_the_better_one_stays(monkeypatch, better):
    def finds(name, origin):
        return 0.3, (10.0 + 5.0 * better if origin.startswith("first") else 12.0) if name == FRICTION else 1.0

    t = Rehearsed(monkeypatch, doubt=0.9, finds=finds)
    t.settle()
    assert [origin for _, origin in t.asked[:2]] == ["base", "first"]
    assert sum(origin == "first" for _, origin in t.asked) == 1
    assert t.leader.evidence == (15.0 if better else 12.0)


@pytest.mark.parametrize("quick", [False, True])
def test_what_comes_nearest_at_strengths_that_show_is_simulated_before_anything_leads(monkeypatch, quick):
    """Derivatives about no damping asked for none of it (open case): drag led, and explained enough not to be doubted."""
    t = Rehearsed(monkeypatch, doubt=0.1, finds=lambda name, _: (0.3, {FRICTION: 5.0, "gravity_tilt": 9.0}.get(name, 1.0)), quick=quick)
    t.proposed = [h for h in t.screened.hypotheses if h.name in ("gravity_tilt", FRICTION)]
    t.settle()
    assert t.probed == ([] if quick else ["gravity_tilt"])  # friction was simulated where derivatives led
    assert t.leader.name == (FRICTION if quick else "gravity_tilt")
    assert [origin for name, origin in t.asked if name == "gravity_tilt"] == ([] if quick else ["probed base"])


@pytest.mark.parametrize(("doubt", "simulated"), [(0.1, 1), (0.4, 2), (0.9, 2)])
def test_where_all_that_leaves_much_as_many_again_are_simulated(monkeypatch, doubt, simulated):
    monkeypatch.setattr(trials, "PROPOSED", 1)
    t = Rehearsed(monkeypatch, doubt=doubt, finds=lambda name, _: (0.3, 20.0 if name == FRICTION else 1.0))
    t.proposed = [h for h in t.screened.hypotheses if h.name != FRICTION]
    t.alike = frozenset({frozenset({FRICTION, t.proposed[1].name})})
    t.settle()
    assert t.probed == [t.proposed[k].name for k in (0, 2)[:simulated]]  # the second is a twin of what was simulated


def test_probes_that_gain_far_less_than_the_nearest_wait(monkeypatch):
    t = Rehearsed(monkeypatch, doubt=0.1, finds=lambda name, _: (0.3, 20.0 if name == FRICTION else 1.0))
    t.proposed = [h for h in t.screened.hypotheses if h.name != FRICTION][:3]
    t.gains = [1.0, 0.6, 0.4]
    t.settle()
    assert t.probed == [h.name for h in t.proposed[:2]]


@pytest.mark.parametrize(("weighs", "doubt", "origins"), [(2.0, 0.1, ["base"]), (2.0, 0.9, ["first"]), (0.5, 0.1, [])])
def test_what_leads_once_another_has_fallen_is_simulated_if_it_is_worth_that(monkeypatch, weighs, doubt, origins):
    t = Rehearsed(monkeypatch, doubt=doubt, finds=lambda name, _: (0.3, -4.0 if name == FRICTION else 9.0))
    rival = next(h for h in t.screened.hypotheses if h.name == "gravity_tilt")
    weighed = replace(rival, weights=(replace(rival.weights[0], likelihood=weighs, prior=0.0),))
    others = [h for h in t.screened.hypotheses if h.evidence < 0.5 and h is not rival]
    t.screened.hypotheses = (next(h for h in t.screened.hypotheses if h.name == FRICTION), weighed, *others)
    t.settle()
    assert [origin for name, origin in t.asked if name == "gravity_tilt"][: len(origins) or None] == origins
    assert (t.leader.evidence == 9.0) is bool(origins)


def test_a_leader_that_probes_leave_in_place_is_not_simulated_again(monkeypatch):
    t = Rehearsed(monkeypatch, doubt=0.9, finds=restless())
    t.proposed = [h for h in t.screened.hypotheses if h.name != FRICTION]
    t.settle()
    assert len(t.probed) > PROPOSED and sum(name == FRICTION for name, _ in t.asked) == 1 + AGAIN


@pytest.mark.parametrize("quick", [False, True])
@pytest.mark.parametrize("better", ["base", "first"])
def test_the_scale_that_lengths_ask_for_is_simulated_afresh_too_and_the_better_one_stays(monkeypatch, quick, better):
    """Afresh alone, a scale of 5 % (open case, 3.7 floors) had evidence −3 with replays no nearer than the base's; in the base's fabric 7.8, and 5."""
    tilted = {better: 20.0}
    t = Rehearsed(
        monkeypatch, doubt=0.9, finds=lambda name, origin: (0.3, tilted.get(origin, 2.0) if name == "gravity_tilt" else 1.0), quick=quick
    )
    (tilt,) = (h for h in t.screened.hypotheses if h.name == "gravity_tilt")
    t.scaled = [replace(tilt, strengths=dict.fromkeys(tilt.strengths, 0.3))]
    t.settle()
    assert t.asked[:2] == [("gravity_tilt", "base"), ("gravity_tilt", "first")]
    assert t.after["gravity_tilt"].hypothesis.evidence == 20.0 and t.leader.name == "gravity_tilt"
    assert t.asked.count(("gravity_tilt", "first")) == 1


def test_in_a_hurry_it_is_simulated_once_more_and_never_afresh(monkeypatch):
    t = Rehearsed(monkeypatch, doubt=0.9, finds=restless(), quick=True)
    t.settle()
    assert t.asked == [(FRICTION, "base"), (FRICTION, "base+")]


@pytest.mark.parametrize("quick", [False, True])
def test_three_that_promise_alike_are_simulated_in_a_hurry_too(monkeypatch, quick):
    """Derivatives had put the demo's drag third, by a hair; with two simulated nothing was named."""
    t = Rehearsed(monkeypatch, doubt=0.0, finds=lambda name, origin: (0.3, 20.0 if name == FRICTION else 1.0), quick=quick)
    most = t.screened.hypotheses[0].evidence
    t.promised = {h.name: TEMPER * (most - h.evidence) for h in t.screened.hypotheses}
    t.settle()
    assert len({name for name, origin in t.asked if origin == "base"}) == 3


@pytest.mark.parametrize("promised", [0.0, 20.0])
def test_what_whole_recordings_promise_is_simulated_at_the_strength_that_they_ask_for(monkeypatch, promised):
    told = []
    t = Rehearsed(monkeypatch, doubt=0.0, finds=lambda name, origin: (7.0, 20.0 if name == FRICTION else 1.0), quick=True)
    t.promised = {FRICTION: promised}
    simulate = t.simulate
    monkeypatch.setattr(t, "simulate", lambda h, start=None: told.append(h.strengths[FRICTION]) or simulate(h, start))
    t.settle()
    assert (told[0] == 7.0) == bool(promised)


def beside_friction(t, evidence, name="gravity_tilt"):
    """The pair that another effect makes with friction, as strong as simulations here find anything."""
    first, other = (next(h for h in t.screened.hypotheses if h.name == n) for n in (FRICTION, name))
    weights = (first.weights[0], replace(other.weights[0], likelihood=evidence, prior=0.0))
    strengths = dict.fromkeys({**first.strengths, **other.strengths}, 0.3)
    return replace(first, effects=(*first.effects, *other.effects), strengths=strengths, weights=weights)


@pytest.mark.parametrize("left", [0.1, 0.9])
def test_probes_are_asked_where_a_second_effect_leaves_much_too(monkeypatch, left):
    t = Rehearsed(monkeypatch, doubt=0.9, finds=lambda name, _: (0.3, 20.0 if name == FRICTION else 1.0))
    monkeypatch.setattr(trials, "foretold_beside", lambda first, pair: (pair, 0.0))
    t.seconds, t.left_with_second = (beside_friction(t, 5.0),), left
    t.proposed = [h for h in t.screened.hypotheses if h.name != FRICTION]
    t.settle()
    assert [name for name, _ in t.asked].count(t.seconds[0].name) == 1
    assert (len(t.probed) > PROPOSED) == (left > 0.5)


@pytest.mark.parametrize(
    ("evidence", "promised", "quick", "simulated"),
    [(5.0, 0.0, False, True), (1.0, 0.0, False, False), (1.0, 4.0, False, True), (1.0, 4.0, True, False)],
)
def test_a_second_effect_is_simulated_where_windows_and_replays_together_promise_one(monkeypatch, evidence, promised, quick, simulated):
    """At the strengths that replays ask for where they say something."""
    finds = {FRICTION: (0.3, 20.0), f"{FRICTION} + gravity_tilt": (7.0 if promised else 0.3, 1.0)}
    t = Rehearsed(monkeypatch, doubt=0.0, finds=lambda name, origin: finds.get(name, (0.3, 1.0)), quick=quick)
    both = beside_friction(t, evidence)
    t.seconds = (both,)
    asked = replace(both, strengths=dict.fromkeys(both.strengths, 7.0))
    monkeypatch.setattr(trials, "foretold_beside", lambda first, pair: (asked, promised))
    told = {}
    simulate = t.simulate
    monkeypatch.setattr(t, "simulate", lambda h, start=None: told.update({h.name: h.strengths[FRICTION]}) or simulate(h, start))
    t.settle()
    assert (both.name in t.after) == simulated
    if simulated:
        assert (told[both.name] == 7.0) == (promised > 0)


@pytest.mark.parametrize(("doubt", "quick"), [(0.2, False), (0.05, False), (0.2, True)])
def test_where_a_leader_leaves_something_second_causes_are_probed_beside_it(monkeypatch, doubt, quick):
    """Derivatives about no damping say nothing of it beside a wind either."""
    t = Rehearsed(monkeypatch, doubt=doubt, finds=lambda name, origin: (0.3, 20.0 if name == FRICTION else 1.0), quick=quick)
    names = [e.name for e in EFFECTS if e.name != FRICTION]
    t.seconds = tuple(beside_friction(t, 5.0 if k == 0 else 1.0, name) for k, name in enumerate(names))
    t.alike = frozenset({frozenset(names[:2])})
    monkeypatch.setattr(trials, "foretold_beside", lambda first, pair: (pair, 0.0))
    t.beside, t.left_with_second = t.seconds, doubt
    t.settle()
    probed = doubt > trials.HARDLY and not quick
    assert t.probed == (names[2:4] if probed else [])  # the first was simulated by derivatives, the second is its twin
    origins = {name: [o for n, o in t.asked if n == f"{FRICTION} + {name}"] for name in names[2:4]}
    assert origins == {name: ["probed corrected"] if probed else [] for name in names[2:4]}


def test_two_second_effects_are_simulated_of_twins_one(monkeypatch):
    """Derivatives had put a wind beside drag before the tilt that there was, and the tilt was never simulated."""
    t = Rehearsed(monkeypatch, doubt=0.0, finds=lambda name, origin: (0.3, 20.0 if name == FRICTION else 1.0))
    names = [e.name for e in EFFECTS if e.name != FRICTION][:4]
    t.seconds = tuple(beside_friction(t, 9.0 - k, name) for k, name in enumerate(names))
    t.alike = frozenset({frozenset(names[:2])})
    monkeypatch.setattr(trials, "foretold_beside", lambda first, pair: (pair, 0.0))
    t.settle()
    assert [pair.name in t.after for pair in t.seconds] == [True, False, True, False]


@pytest.mark.parametrize("moves", [True, False])
def test_a_pair_that_moves_is_simulated_once_more(monkeypatch, moves):
    """As single effects are, but once."""
    strength = {True: 0.3, False: 0.3}

    def finds(name, origin):
        pair = "+" in name
        strength[pair] *= 1.5 if pair and moves else 1.0
        return strength[pair], 20.0

    t = Rehearsed(monkeypatch, doubt=0.0, finds=finds)
    monkeypatch.setattr(trials, "foretold_beside", lambda first, pair: (replace(pair, strengths=dict.fromkeys(pair.strengths, 0.3)), 9.0))
    t.seconds = (beside_friction(t, 9.0),)
    t.settle()
    assert [name for name, _ in t.asked].count(t.seconds[0].name) == 1 + moves


@pytest.mark.parametrize("quick", [False, True])
def test_in_a_hurry_no_second_cause_is_sought(monkeypatch, quick):
    """The verdict of a quick diagnosis had named pairs by derivatives, and simulated them."""
    t = Rehearsed(monkeypatch, doubt=0.0, finds=lambda name, origin: (0.3, 20.0 if name == FRICTION else 1.0), quick=quick)
    t.settle()
    monkeypatch.setattr(trials, "searched", lambda named: (beside_friction(t, 5.0),))
    assert [pair.name for pair in Trials.pairs(t)] == ([] if quick else [f"{FRICTION} + gravity_tilt"])


@pytest.mark.parametrize(("quick", "simulated"), [(False, True), (True, True), (False, False)])
def test_the_base_is_asked_for_in_the_fabric_of_a_leader_that_was_simulated(monkeypatch, quick, simulated):
    t = Rehearsed(monkeypatch, doubt=0.0, finds=lambda name, origin: (0.3, 20.0 if name == FRICTION else 1.0), quick=quick)
    monkeypatch.setattr(trials, "nested_base", lambda base, data, fabric, run: fabric.name)
    if simulated:
        t.settle()
    assert t.nested_base() == ("the leader's" if simulated and not quick else None)
