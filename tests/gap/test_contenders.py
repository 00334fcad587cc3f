"""Which hypotheses the simulator refits."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tasks.cloth.windows import Window
from tasks.gap import refits
from tasks.gap.hypotheses import FORM
from tasks.gap.refits import Refitted, as_simulated, comes_nearer, contenders, searched
from tasks.gap.replay import Replay, Replayed, supported
from tests.gap.test_hypotheses import EFFECTS, windows

NOBODY = frozenset()


def ranked(truth, **options):
    w = windows(np.random.default_rng(0), truth=truth, **options)
    return sorted((w.fit([e]) for e in EFFECTS), key=lambda h: -h.evidence)


def test_the_strongest_are_refitted_and_nothing_where_nothing_is_strong():
    assert contenders(ranked({"contact_friction": 0.3}), [], 3, NOBODY, 0.0)[0].name == "contact_friction"
    assert contenders(ranked({}), [], 3, NOBODY, 0.0) == []


def test_more_evidence_is_asked_for_where_replays_say_that_nothing_is_missing():
    friction = ranked({"contact_friction": 0.3})[0]
    weak = replace(friction, weights=(replace(friction.weights[0], likelihood=2.0, prior=0.0),))
    assert [contenders([weak], [], 3, NOBODY, missing) for missing in (3.0, 0.0, -0.5, -2.0)] == [[weak], [weak], [weak], []]


def test_what_whole_recordings_ask_for_is_refitted_though_windows_hardly_do():
    singles = ranked({"contact_friction": 0.3})
    tilt = next(h for h in singles if h.name == "gravity_tilt")
    assert tilt not in contenders(singles, [], 3, NOBODY, 3.0)
    assert contenders(singles, [], 3, NOBODY, 3.0, {tilt.name: 12.0 + singles[0].evidence})[0] is tilt
    assert (
        contenders(singles, [], 3, NOBODY, 3.0, {singles[0].name: -1e3})[0] is singles[0]
    )  # of what derivatives foretell, only what speaks for it


def test_of_twins_one_is_refitted():
    singles = ranked({"air_normal_drag": 8.0}, alike=[("air_normal_drag", "fabric_mass_damping")])
    first, second = singles[:2]
    assert {first.name, second.name} == {"air_normal_drag", "fabric_mass_damping"}
    assert {h.name for h in contenders(singles, [], 3, NOBODY, 0.0)} >= {first.name, second.name}
    assert second.name not in {h.name for h in contenders(singles, [], 3, frozenset([frozenset([first.name, second.name])]), 0.0)}


def test_what_was_seen_otherwise_keeps_its_own_strength_and_leaves_room_for_one_more():
    singles = ranked({"contact_friction": 0.3})
    tilt = next(h for h in singles if h.name == "gravity_tilt")
    seen = replace(tilt, strengths=dict.fromkeys(tilt.strengths, 0.1))
    chosen = contenders(singles, [seen], 1, NOBODY, 0.0)
    assert chosen[0] is seen
    assert [h.name for h in chosen] == ["gravity_tilt", "contact_friction"]


def test_a_twin_of_what_was_simulated_does_not_lead_by_what_it_was_before():
    """The linear estimate of one twin must not beat the other's simulation, which it would only repeat."""
    singles = ranked({"air_normal_drag": 8.0}, alike=[("air_normal_drag", "fabric_mass_damping")])
    drag, damping = (next(h for h in singles if h.name == name) for name in ("air_normal_drag", "fabric_mass_damping"))
    worse = replace(drag, weights=(replace(drag.weights[0], likelihood=3.0),), forcing=0.5)
    after = {drag.name: Refitted(worse, None, (), None)}
    apart, together = (as_simulated(singles, after, alike) for alike in (NOBODY, frozenset([frozenset([drag.name, damping.name])])))
    assert max(apart, key=lambda h: h.evidence).name == damping.name
    told = {h.name: h for h in together}
    assert told[drag.name] is worse and told[damping.name].strengths == damping.strengths
    assert worse.evidence - 0.1 < told[damping.name].evidence < worse.evidence
    assert told[damping.name].forcing == 0.5


def replay(replayed):
    return Replay(replayed, None, np.zeros((1, 1, 3)), np.ones(0), None)


def test_only_what_came_nearer_over_whole_recordings_predicts_others():
    base = Replayed(4e-6, 1e-6)
    nearer, further = (Refitted(None, None, (), None, (replay(Replayed(gap, 1e-6)), None)) for gap in (3e-6, 5e-6))
    assert comes_nearer(nearer, base) and not comes_nearer(further, base)
    assert comes_nearer(Refitted(None, None, (), None), base)  # could not be replayed


@pytest.mark.parametrize(
    ("windows", "sd", "together", "come", "kept"),
    [
        (0.3, 0.1, 0.31, [], 0.31),  # near what was simulated
        (0.3, 0.1, 0.6, [1e-6], 0.6),  # comes nearer
        (0.3, 0.1, 0.6, [9e-6], 0.3),
        (0.3, 0.1, 0.6, [np.nan], 0.3),  # lost
        (0.3, 0.01, 0.6, [1e-6], 0.3),  # comes nearer by less than windows are sure of
        (0.6, 0.1, 0.31, [1e-6], 0.6),  # held where it was simulated, by derivatives that lead nowhere
        (0.6, 0.2, 0.31, [9e-6], 0.31),
        (0.6, 0.01, 0.31, [9e-6], 0.6),  # further off by less than windows are sure of
        (0.6, 0.1, 0.31, [np.nan], 0.31),
        (0.9, 0.5, 0.6, [1e-6, 2e-6], 0.6),
        (0.9, 0.5, 0.6, [2e-6, 1e-6], 0.9),
        (0.9, 0.5, 0.6, [9e-6, 9e-6], 0.9),  # windows alone, beside the replay as it was simulated
    ],
)
def test_what_windows_and_replays_ask_for_is_replayed_where_it_is_far_from_what_was_simulated(
    monkeypatch, windows, sd, together, come, kept
):
    """Simulated at 0.3, replays then 4 mm² off; windows ask for 0.3 to 0.9 ± sd, they and replays together for something else, of which
    further replays `come`.
    """
    h = ranked({"contact_friction": 0.3})[0]
    covariance = np.array([[sd**2 + (FORM * windows) ** 2]])  # the doubt about the law's form is no part of what they disagree by
    asking = replace(h, strengths=dict.fromkeys(h.strengths, windows), covariance=covariance, base=np.zeros(2))
    model = SimpleNamespace(strength=lambda e: np.array([0.3]))
    todo, told = iter([4e-6, *come]), []

    def replays(*_, **__):
        told.append(next(todo))
        return (None if np.isnan(told[-1]) else replay(Replayed(told[-1], 1e-6, 20e-6)),)

    monkeypatch.setattr(refits, "replayed_by", replays)
    monkeypatch.setattr(refits, "replayed_by_each", lambda models, *_: [replays() for _ in models])
    monkeypatch.setattr(refits, "mean_normals", lambda _: "normals")
    monkeypatch.setattr(refits, "joint", lambda h, *_: replace(h, strengths=dict.fromkeys(h.strengths, together)))
    monkeypatch.setattr(refits, "corrected_model", lambda _: None)
    found = refits.replayed(Refitted(asking, model, (), SimpleNamespace(origin={})), (replay(Replayed(8e-6, 1e-6)),), None)
    assert found.hypothesis.strengths == dict.fromkeys(h.strengths, kept) and len(told) == 1 + len(come)
    assert found.replayed.gap in told
    assert found.hypothesis.support == supported(Replayed(8e-6, 1e-6), Replayed(found.replayed.gap, 1e-6, 20e-6))


@pytest.mark.parametrize("first", [5.0, None])
def test_a_second_cause_is_weighed_against_replays_of_the_first(monkeypatch, first):
    """Where the first was replayed; else against the base."""
    h = replace(ranked({"contact_friction": 0.3})[0], base=np.zeros(2))
    model = SimpleNamespace(strength=lambda e: np.array(list(h.strengths.values())))
    x = {d: np.full((3, 4, 3), d) for d in (0.0, 1e-3, 3e-3)}
    base, alone, both = ((Replay(Replayed(gap, 1e-6, apart), Window(0, 0, 2), x[d], np.full(2, 1e-6), None),) for gap, apart, d in OFF)
    monkeypatch.setattr(refits, "replayed_by", lambda *_, **__: both)
    monkeypatch.setattr(refits, "mean_normals", lambda _: "normals")
    monkeypatch.setattr(refits, "joint", lambda windows, *_: windows)
    beside = Refitted(replace(h, support=first), model, (), None, alone)
    found = refits.replayed(Refitted(h, model, (), SimpleNamespace(origin={})), base, None, beside=beside)
    if first is None:
        assert found.hypothesis.support == supported(Replayed(9e-6, 1e-6), Replayed(1e-6, 1e-6, 27e-6))
    else:
        assert found.hypothesis.support == pytest.approx(5.0 + supported(Replayed(1.5e-6, 1e-6), Replayed(1e-6, 1e-6, 12e-6)))


def test_a_step_taken_back_takes_its_replays_along():
    """Replays of the step came nearer than the simulated strength's: they say nothing for that one."""
    h = replace(ranked({"contact_friction": 0.3})[0], base=np.array([0.5, 0.0]), support=9.0)
    model = SimpleNamespace(strength=lambda e: np.array([0.2]), by_column=lambda effects: dict.fromkeys(h.strengths, 0.2))
    base, simulated, stepped = ((replay(Replayed(gap, 1e-6, 20e-6)),) for gap in (8e-6, 5e-6, 1e-6))
    found = refits.taken_back(Refitted(h, model, (), None, stepped, simulated), base)
    assert found.hypothesis.strengths == dict.fromkeys(h.strengths, 0.2) and not found.hypothesis.base.any()
    assert found.replayed.gap == 5e-6
    assert found.hypothesis.support == supported(Replayed(8e-6, 1e-6), Replayed(5e-6, 1e-6, 20e-6))
    assert refits.taken_back(Refitted(h, model, (), None), base).hypothesis.support == 9.0  # never replayed


OFF = (
    (9e-6, 0.0, 0.0),
    (1.5e-6, 3e-6, 1e-3),
    (1e-6, 27e-6, 3e-3),
)  # E and d² [m²] and where the replay is [m]: of the base, the first cause, both


def test_of_what_stands_beside_the_first_whole_recordings_say_what_they_say_of_it():
    w = windows(np.random.default_rng(0), truth={"contact_friction": 0.3})
    first = replace(w.fit([e for e in EFFECTS if e.name == "contact_friction"]), support=6.0)
    found = searched(Refitted(first, None, (), w))
    assert {pair.effects[1].name for pair in found} == {e.name for e in EFFECTS} - {"contact_friction"}
    assert all(pair.effects[0] is first.effects[0] and pair.support == 6.0 for pair in found)
    assert searched(Refitted(found[0], None, (), w)) == ()  # no third
