"""A hypothesis simulated again, where some windows, or too many, cannot be followed with it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tasks.effects.model import Model
from tasks.gap import refits
from tasks.gap.hypotheses import Windows
from tasks.gap.refits import refitted
from tasks.simulator.fabric import Fabric
from tests.gap.test_hypotheses import EFFECTS, windows

FRICTION = next(e for e in EFFECTS if e.name == "contact_friction")
COUNT, TRUE = 8, 0.3


@pytest.fixture
def simulated(monkeypatch):
    """`refitted` where `lost(θ)` of the windows, the first ones, cannot be followed at friction θ; with the strengths that were simulated,
    and the base's windows.
    """
    taught = windows(np.random.default_rng(0), truth={"contact_friction": TRUE}, count=COUNT)
    monkeypatch.setattr(refits, "compressed", lambda evidence, *_: [e.normals for e in evidence])
    monkeypatch.setattr(refits, "with_fabric", lambda model, fabric: model)

    def run(lost, *, start=None):
        asked = []

        def follow(model, *_):
            there = float(model.strength(FRICTION)[0])
            asked.append(there)
            each = enumerate(taught.given)
            return [
                SimpleNamespace(normals=about(n, {"contact_friction": there}), prediction=SimpleNamespace(complete=k >= lost(there)))
                for k, n in each
            ]

        monkeypatch.setattr(refits, "_simulated", follow)
        base = Model(SimpleNamespace(fabric=Fabric()), None)
        screened = SimpleNamespace(base=SimpleNamespace(model=base), evidence=(), windows=taught, prior=None, doubt=None)
        hypothesis = replace(taught.fit([FRICTION]), base=np.zeros(2), strengths={"contact_friction": TRUE})
        begun = None if start is None else base.joined([], {"contact_friction": np.array([start])})
        return refitted(screened, None, hypothesis, EFFECTS, start=begun), asked, taught

    return run


def about(n, origin):
    """Normal equations [P] about strengths instead of zero."""
    step = np.array([origin.get(name, 0.0) for name in n.names])
    return replace(n, g=n.g - n.G @ step, c=float(n.c - 2 * n.g @ step + step @ n.G @ step))


def test_all_windows_followed_weigh_as_they_did_about_the_base(simulated):
    found, asked, taught = simulated(lambda θ: 0)
    assert asked == [TRUE] and found.against is taught
    assert found.hypothesis.strengths["contact_friction"] == pytest.approx(taught.fit([FRICTION]).strengths["contact_friction"], rel=1e-4)


@pytest.mark.parametrize("lost", [1, 2])
def test_windows_that_cannot_be_followed_leave_the_word_to_the_others(simulated, lost):
    found, asked, taught = simulated(lambda θ: lost)
    others = Windows(taught.given[lost:], EFFECTS).fit([FRICTION])
    assert asked == [TRUE] and len(found.windows) == len(found.against) == COUNT - lost
    assert found.hypothesis.evidence == pytest.approx(others.evidence, rel=0.02) and found.hypothesis.evidence > 5


@pytest.mark.parametrize(("start", "half"), [(None, 0.5 * TRUE), (0.1, 0.5 * (0.1 + TRUE))])
def test_where_too_few_can_it_goes_half_the_way_and_derivatives_tell_the_rest(simulated, start, half):
    found, asked, taught = simulated(lambda θ: 3 if θ > 0.25 else 0, start=start)
    assert asked == pytest.approx([TRUE, half]) and len(found.windows) == COUNT
    assert float(found.model.strength(FRICTION)[0]) == pytest.approx(half) and found.windows.origin == {
        "contact_friction": pytest.approx(half)
    }
    assert found.hypothesis.strengths["contact_friction"] == pytest.approx(taught.fit([FRICTION]).strengths["contact_friction"], rel=1e-4)


@pytest.mark.parametrize(("start", "times"), [(None, 2), (TRUE, 1)])
def test_what_cannot_be_followed_either_way_has_no_evidence(simulated, start, times):
    """From where it already stands there is no half-way."""
    found, asked, _ = simulated(lambda θ: 3, start=start)
    assert found.windows is None and found.hypothesis.evidence == 0 and len(asked) == times


DRAG = next(e for e in EFFECTS if e.name == "air_normal_drag")


@pytest.mark.parametrize(("lost", "count"), [((), COUNT), ((1,), COUNT - 1)])
def test_a_second_cause_is_weighed_by_what_it_adds_to_the_first_as_that_was_simulated(monkeypatch, lost, count):
    """Where derivatives hold exactly, simulating a pair changes nothing of what either cause weighs. `lost`: windows that cannot be followed
    with the first cause alone: they have no say about the second.
    """
    monkeypatch.setattr(refits, "compressed", lambda evidence, *_: [e.normals for e in evidence])
    monkeypatch.setattr(refits, "with_fabric", lambda model, fabric: model)
    taught = windows(np.random.default_rng(0), truth={"contact_friction": TRUE, "air_normal_drag": 6.0}, count=COUNT)
    base = Model(SimpleNamespace(fabric=Fabric()), None)
    screened = SimpleNamespace(base=SimpleNamespace(model=base), evidence=(), windows=taught, prior=None, doubt=None)

    def follow(model, *_):
        θ = model.by_column([DRAG, FRICTION])
        alone = not θ["contact_friction"]
        each = enumerate(taught.given)
        return [SimpleNamespace(normals=about(n, θ), prediction=SimpleNamespace(complete=not (alone and k in lost))) for k, n in each]

    monkeypatch.setattr(refits, "_simulated", follow)
    first = refitted(screened, None, taught.fit([DRAG]), EFFECTS)
    (pair,) = (p for p in refits.searched(first) if p.effects[1] is FRICTION)
    both = refitted(screened, None, pair, EFFECTS, start=first.model, beside=first)
    assert len(both.windows) == count and pair.weights[1].evidence > 10
    for simulated, foretold in zip(both.hypothesis.weights, pair.weights, strict=True):
        assert simulated.evidence == pytest.approx(foretold.evidence, abs=1e-3)


def test_a_first_cause_that_explains_more_alone_than_was_foretold_leaves_the_second_less():
    taught = windows(np.random.default_rng(0), truth={"contact_friction": TRUE, "air_normal_drag": 6.0}, count=COUNT)
    θ = {"air_normal_drag": 6.0, "contact_friction": TRUE}
    both, alone = ([about(n, origin) for n in taught.given] for origin in (θ, {"air_normal_drag": 6.0}))

    def second(nearer):
        first = Windows([replace(n, c=n.c - nearer) for n in alone], EFFECTS, {"air_normal_drag": 6.0})
        return taught.about(both, [DRAG, FRICTION], θ, first).fit([DRAG, FRICTION]).weights[1]

    scale = taught.about(both, [DRAG, FRICTION], θ).scale
    assert second(0.0).decrease - second(3.0).decrease == pytest.approx(3.0 * np.sum(1 / scale))
    assert second(3.0).evidence < second(0.0).evidence
