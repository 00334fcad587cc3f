"""Which cases an exam holds."""

from collections import Counter

import pytest

from tasks.effects.library import library, suspects
from tasks.exam.generator.causes import CAUSES, LIBRARY, OUTSIDE
from tasks.exam.generator.scenes import MOTIONS
from tasks.exam.generator.strata import STRATA, admissible, drawn, questions


def test_full_exam_has_the_strata_asked_for():
    assert Counter(q.stratum for q in questions(160, 0)) == STRATA


def test_any_beginning_is_a_fair_sample():
    first = Counter(q.stratum for q in questions(160, 0)[:40])
    assert all(abs(first[s] - n / 4) <= 1 for s, n in STRATA.items())


def test_every_effect_is_asked_for_and_withheld_effects_differ():
    cases = questions(160, 3)
    assert {n for q in cases if q.stratum == "single" for n in q.causes} == set(LIBRARY)
    withheld = [q for q in cases if q.stratum == "outside" and q.withheld]
    assert len(withheld) == 12 == len({name for q in withheld for name in q.causes})
    assert {n for q in cases if q.stratum == "outside" and not q.withheld for n in q.causes} == set(OUTSIDE)


def test_whatever_may_stand_for_a_withheld_effect_is_withheld_too():
    """Its class-mate, left in the library, would be named, rightly, and count as wrong."""
    for q in questions(160, 3):
        if q.stratum == "outside" and q.withheld:
            assert all(admissible(name) <= set(q.withheld) for name in q.causes)


def test_being_without_effects_tells_no_stratum_but_makes_outside_three_times_as_likely():
    """Half of what is outside must do without something, a fifth of all others: P(outside | without) = 0.31, P(outside | with all) = 0.10."""
    every = [q for seed in range(10) for q in questions(160, seed)]
    cases = [q for q in every if q.stratum != "outside"]
    decoys = [q for q in cases if q.withheld]
    assert 0.15 < len(decoys) / len(cases) < 0.25
    assert {q.stratum for q in decoys} == {q.stratum for q in cases}
    assert not any(admissible(name) & set(q.withheld) for q in decoys for name in q.causes)

    def outside(without):
        asked = [q.stratum == "outside" for q in every if bool(q.withheld) is without]
        return sum(asked) / len(asked)

    assert outside(True) == pytest.approx(0.31, abs=0.03) and outside(False) == pytest.approx(0.10, abs=0.01)


def test_the_same_seed_asks_the_same_and_another_something_else():
    assert questions(20, 1) == questions(20, 1)
    assert questions(20, 1) != questions(20, 2)


def test_garments_can_show_what_is_asked_and_motions_differ():
    for q in questions(160, 5):
        for attempt in range(3):
            d = drawn(q, attempt)
            assert all(d.kind in CAUSES[n].needs for n in d.causes)
            assert len(set(d.motions)) == 3 and set(d.motions) <= set(MOTIONS[d.kind])


def test_pairs_are_of_two_families():
    pairs = [tuple(q.causes) for seed in range(3) for q in questions(160, seed) if q.stratum == "pair"]
    assert all(a.split("_")[0] != b.split("_")[0] and not admissible(a) & admissible(b) for a, b in pairs)


def test_admissible_classes_hold_the_name_and_are_small():
    assert all(name in admissible(name) and len(admissible(name)) <= 5 for name in LIBRARY)
    assert "contact_thickness" in admissible("body_offset") and "body_lag" in admissible("observation_delay")


@pytest.mark.parametrize("name", LIBRARY)
def test_names_and_units_are_those_that_the_diagnosis_uses(name):
    """The generator cannot import the library; this test is where the two are compared."""
    named = {e.name: e for e in suspects(library().values())}
    assert name in named
    cause, strengths = CAUSES[name], {s.symbol: s for s in named[name].strengths}
    along = strengths[cause.along] if cause.along else None
    assert cause.along is None or len(strengths) > 1
    assert cause.unit == named[name].strengths[0].unit
    within = [along] if along else list(strengths.values())
    assert all(cause.guess <= cause.most <= s.high and (not cause.symmetric or -cause.most >= s.low) for s in within)


def test_every_effect_that_a_verdict_may_name_is_in_the_exam():
    assert {e.name for e in suspects(library().values())} == set(LIBRARY)
