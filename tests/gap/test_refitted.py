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
            return [SimpleNamespace(normals=about(n, there), prediction=SimpleNamespace(complete=k >= lost(there))) for k, n in each]

        monkeypatch.setattr(refits, "_simulated", follow)
        base = Model(SimpleNamespace(fabric=Fabric()), None)
        screened = SimpleNamespace(base=SimpleNamespace(model=base), evidence=(), windows=taught, prior=None, doubt=None)
        hypothesis = replace(taught.fit([FRICTION]), base=np.zeros(2), strengths={"contact_friction": TRUE})
        begun = None if start is None else base.joined([], {"contact_friction": np.array([start])})
        return refitted(screened, None, hypothesis, EFFECTS, start=begun), asked, taught

    return run


def about(n, θ):
    """Normal equations [P] about friction θ instead of zero."""
    step = np.array([θ * (name == "contact_friction") for name in n.names])
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
