"""The verdict in words."""

from types import SimpleNamespace

import numpy as np
import pytest

from tasks.gap.answer import sentence
from tasks.gap.held_out import Shrinkage
from tasks.gap.verdict import Candidate, Verdict


def told(before, floor, fraction):
    gap = Shrinkage(before, before, floor, fraction, fraction, fraction, True)
    return sentence(SimpleNamespace(verdict=Verdict("none", None, (), 0.6, ()), shrinkage=gap))


def test_none_at_the_floor_needs_nothing_and_none_above_it_found_nothing():
    assert "is needed to explain that (probability 60%)" in told(3.3, 3.5, None)
    assert "was found to explain that (probability 60%)" in told(8.6, 3.8, 0.0)


def test_a_name_that_takes_the_place_of_another_says_so():
    gap = Shrinkage(10.0, 3.0, 1.0, 0.9, 0.8, 1.0, True)
    told = [
        sentence(SimpleNamespace(verdict=Verdict("effect", object(), (("drag",),), 0.7, (), reason), shrinkage=gap))
        for reason in ("", "friction leads, but no")
    ]
    assert "(floor 1.0 mm); the cause is drag (probability 70%); with it" in told[0]
    assert "; friction leads, but no, so of what is left the cause is drag (probability 70%); with it" in told[1]


@pytest.mark.parametrize(
    ("classes", "words"),
    [
        ((("drag", "damping"),), "the cause is drag or damping (probability"),
        ((("drag", "damping"), ("tilt",)), "the causes are drag or damping, and tilt (probability"),
    ],
)
def test_two_causes_are_told_from_two_names_of_one(classes, words):
    """Of a pair it had said "the cause is one of drag, damping and tilt"."""
    gap = Shrinkage(10.0, 3.0, 1.0, 0.9, 0.8, 1.0, True)
    assert words in sentence(SimpleNamespace(verdict=Verdict("effect", object(), classes, 0.7, ()), shrinkage=gap))


def test_a_single_window_kept_out_has_a_share_without_an_interval():
    gap = Shrinkage(10.0, 3.0, 1.0, 0.9, None, None, True)
    told = sentence(SimpleNamespace(verdict=Verdict("effect", object(), (("drag",),), 0.7, ()), shrinkage=gap))
    assert told.endswith("falls to 3.0 mm (90% of what can be closed).")


def test_how_motion_kept_out_was_compared_is_said():
    ends = []
    for held_out, replayed in ((False, False), (True, False), (True, True)):
        gap = Shrinkage(10.0, 3.0, 1.0, 0.9, 0.8, 1.0, held_out, 1.0, replayed)
        ends.append(sentence(SimpleNamespace(verdict=Verdict("effect", object(), (("drag",),), 0.7, ()), shrinkage=gap)).split("gap ")[1])
    training, windows, whole = (end.split(" 3.0 mm")[0] for end in ends)
    assert (training, windows) == ("falls to", "on motion kept out of the fit falls to")
    assert whole == "on motion kept out of the fit, replayed in one run, falls to"


def test_a_name_at_the_floor_says_by_what_it_is_confirmed():
    gap = Shrinkage(2.6, 2.7, 2.8, None, None, None, True, 0.9)
    told = sentence(SimpleNamespace(verdict=Verdict("effect", object(), (("drag",),), 0.7, ()), shrinkage=gap))
    assert told.endswith(
        "(floor 2.8 mm); the cause is drag (probability 70%), though on motion kept out of the fit there is nothing to close."
    )


def test_what_motion_kept_out_says_nothing_of_is_still_told():
    gap = Shrinkage(2.6, 2.6, 2.8, None, None, None, True)
    ranking = (Candidate(("drag", "lag"), 0.9, object()), Candidate(("none",), 0.1))
    found = SimpleNamespace(verdict=Verdict("none", None, (), 0.1, ranking, "drag leads, but no"), shrinkage=gap)
    assert "; drag leads, but no, so nothing is named (none: probability 10%; drag or lag: 90%)." in sentence(found)


@pytest.mark.parametrize("reason", ["4 windows are too few"])
def test_what_cannot_be_tested_says_why(reason):
    nothing = Shrinkage(np.nan, np.nan, np.nan, None, None, None, False)
    found = SimpleNamespace(verdict=Verdict("not_testable", None, (), 1.0, (), reason), shrinkage=nothing)
    assert sentence(found) == f"Not testable: {reason}."
