"""What a verdict says of its ranking: how many names nine tenths of the probability need, and what is left of two causes when one goes."""

from dataclasses import dataclass

import numpy as np
import pytest

from tasks.effects.library import library
from tasks.gap.hypotheses import Fitted, Weight
from tasks.gap.verdict import Candidate, Verdict, first_alone, judge

LIBRARY = library()


@dataclass(frozen=True)
class Alone:
    """All that a verdict asks of a fitted hypothesis here."""

    effects: tuple[str, ...]

    @property
    def name(self):
        return " + ".join(self.effects)


DRAG, BOTH = Alone(("drag",)), Alone(("drag", "friction"))


def ranked(*candidates):
    return Verdict("effect", candidates[0].fitted, (candidates[0].names,), candidates[0].probability, candidates)


@pytest.mark.parametrize(
    ("probabilities", "expected"),
    [
        ((0.95, 0.03, 0.02), ["drag", "lift"]),
        ((0.9, 0.06, 0.04), ["drag", "lift"]),  # nine tenths exactly are enough
        ((0.8, 0.15, 0.05), ["drag", "lift", "none"]),
        ((0.5, 0.3, 0.2), ["drag", "lift", "none", "friction"]),
    ],
)
def test_an_answer_set_holds_nine_tenths_and_no_more_names(probabilities, expected):
    names = (("drag", "lift"), ("none",), ("drag", "friction"))  # a name that stands twice is told once
    verdict = ranked(*(Candidate(n, p) for n, p in zip(names, probabilities, strict=True)))
    assert verdict.answer_set == expected


def test_the_first_of_two_causes_keeps_its_class_and_takes_the_weight_of_both():
    other = Candidate(("none",), 0.2)
    both, own = Candidate(("drag", "friction"), 0.5, BOTH), Candidate(("drag", "lift"), 0.3, DRAG, (Alone(("lift",)),))
    left = first_alone(ranked(both, own, other), DRAG)
    assert left.classes == (("drag", "lift"),) and left.probability == pytest.approx(0.8)
    assert [c.names for c in left.ranking] == [("drag", "lift"), ("none",)] and left.ranking[0].others == own.others


def test_and_stands_by_itself_where_it_was_not_ranked():
    left = first_alone(ranked(Candidate(("drag", "friction"), 0.6, BOTH), Candidate(("none",), 0.4)), DRAG)
    assert left.classes == (("drag",),) and left.probability == 0.6 and left.named is DRAG


def weighed(evidence, *names, pair_evidence=0.0):
    weights = tuple(Weight(1.0, 1.0, 1.0, e, 0.0) for e in (evidence, pair_evidence)[: len(names)])
    effects = tuple(LIBRARY[n] for n in names)
    return Fitted(effects, np.zeros(2), np.eye(2), {}, np.eye(0), np.ones(3), weights)


def test_probabilities_by_hand():
    """Two singles of evidence 3 and 1, replays that say 0.5 of anything, a doubt of 0.4: each weight beside the others."""
    singles = [weighed(1.0, "body_lag"), weighed(3.0, "air_normal_drag")]
    found = judge(singles, unexplained=0.4, missing=0.5)
    drag, lag = ((1 - 0.8 * 0.4) / 2 * np.exp(0.8 * e + 0.5) for e in (3.0, 1.0))
    weight = {
        "none": 0.6,
        "outside_library": 0.4 * (np.exp(0.5) + 0.15 * (drag + lag)),
        "air_normal_drag": drag,
        "body_lag": lag,
    }
    for candidate in found.ranking:
        (name,) = candidate.names
        assert candidate.probability == pytest.approx(weight[name] / sum(weight.values()))


def test_the_classes_of_a_pair_hold_four_names_in_all():
    """An answer with more counts for nothing."""
    firsts, seconds = ["air_normal_drag", "air_linear_drag", "fabric_mass_damping"], ["gravity_tilt", "air_wind"]
    singles = [weighed(9.0 - 0.1 * k, n) for k, n in enumerate(firsts)] + [weighed(-9.0, n) for n in seconds]
    pairs = [weighed(9.0, "air_normal_drag", n, pair_evidence=9.0 - 0.1 * k) for k, n in enumerate(seconds)]
    found = judge(singles, pairs, unexplained=0.0)
    assert found.classes == (tuple(firsts[:2]), tuple(seconds)) and found.ranking[0].names == (*firsts[:2], *seconds)


def test_a_pair_by_hand_and_what_its_class_is_called():
    """The second effect weighs 0.3 of a single, beside the first; of names that no longer fit into a class the first four are told."""
    first = weighed(4.0, "air_normal_drag")
    names = ["body_lag", "fabric_stiffening", "air_lift", "fabric_crease", "contact_friction"]
    singles = [first, *(weighed(-9.0, n) for n in names)]
    second = weighed(4.0, "air_normal_drag", "body_lag", pair_evidence=3.0)
    near = [weighed(4.0, "air_normal_drag", n, pair_evidence=3.0 - 0.1 * k) for k, n in enumerate(names[1:], 1)]
    alone = np.exp(0.8 * 4.0) / 6
    for count, expected in ((2, 3), (3, 4), (4, 4)):
        found = judge(singles, [second, *near[: count - 1]], unexplained=0.0)
        (pair,) = (c for c in found.ranking if c.fitted is second)
        assert pair.names == ("air_normal_drag", *names[: expected - 1])
        weight = 0.3 / 6 * np.exp(0.8 * 3.0) * alone
        rest = 5 * np.exp(-0.8 * 5.0) / 6  # nothing is excluded by more than 5
        assert pair.probability == pytest.approx(weight / (weight + alone + rest + 1))


@pytest.mark.parametrize(("evidence", "beside"), [(900.0, 0.0), (500.0, 400.0), (-9.0, 2000.0)])
def test_no_evidence_is_too_large_to_be_a_probability(evidence, beside):
    """Weights are exponentials of it, and that of 720 is no number."""
    lag, drag = weighed(1.0, "body_lag"), weighed(evidence, "air_normal_drag")
    pairs = [weighed(evidence, "air_normal_drag", "body_lag", pair_evidence=beside)] if beside else []
    found = judge([drag, lag] if evidence > 0 else [drag], pairs, unexplained=0.1)
    (leader, *_) = found.ranking
    assert found.probability == pytest.approx(1 / (1 + 0.1 * 0.15), rel=1e-3) and leader.fitted is (pairs or [drag])[0]
    assert sum(c.probability for c in found.ranking) == pytest.approx(1)


def test_replays_that_say_as_much_of_anything_leave_outside_the_library_its_share():
    found = judge([weighed(-9.0, "body_lag")], unexplained=0.5, missing=1000.0)
    assert found.ranking[0].names == ("outside_library",) and np.isfinite(found.probability)
