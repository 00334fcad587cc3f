"""A hypothesis weighed by further windows, as motion kept out is where nothing can shrink."""

from types import SimpleNamespace

import numpy as np
import pytest

from tasks.gap import refits, trials
from tasks.gap.hypotheses import Windows
from tasks.gap.refits import Refitted, weighed_with
from tasks.gap.screening import Screened, ranked
from tasks.gap.trials import Trials
from tests.gap import synthetic
from tests.gap.test_hypotheses import EFFECTS, windows

FRICTION = next(e for e in EFFECTS if e.name == "contact_friction")
TAUGHT, KEPT = 6, 3


@pytest.fixture
def asked(monkeypatch):
    """Weighed by windows that teach, which hold the cause, then by windows kept out that hold it at `there` times its strength; `lost` of
    these cannot be followed.
    """
    monkeypatch.setattr(refits, "compressed", lambda evidence, *_: [e.normals for e in evidence])

    def run(there, lost=0):
        taught = windows(np.random.default_rng(0), truth={"contact_friction": 0.3}, count=TAUGHT)
        kept = windows(np.random.default_rng(1), truth={"contact_friction": 0.3 * there}, count=KEPT).given
        evidence = [SimpleNamespace(normals=n, prediction=SimpleNamespace(complete=k >= lost)) for k, n in enumerate(kept)]
        monkeypatch.setattr(refits, "_simulated", lambda *_: evidence)
        before = [SimpleNamespace(normals=n, prediction=SimpleNamespace(complete=True)) for n in kept]
        named = Refitted(taught.fit([FRICTION]), None, (), taught, against=taught)
        return named, weighed_with(named, SimpleNamespace(prior=None, doubt=None), None, before), taught, kept

    return run


def test_it_weighs_what_all_windows_together_say(asked):
    _, after, taught, kept = asked(1.0)
    together = Windows([*taught.given, *kept], EFFECTS).fit([FRICTION])
    assert after.hypothesis.evidence == pytest.approx(together.evidence, rel=0.02)
    assert len(after.windows) == TAUGHT + KEPT


def test_more_where_they_hold_the_cause_too_less_where_they_do_not_and_its_strength_stays(asked):
    (named, same, *_), (_, without, *_), (_, against, *_) = asked(1.0), asked(0.0), asked(-1.0)
    assert same.hypothesis.evidence > named.hypothesis.evidence > without.hypothesis.evidence > against.hypothesis.evidence
    for each in (same, without, against):
        assert each.hypothesis.strengths == named.hypothesis.strengths and np.array_equal(each.hypothesis.base, named.hypothesis.base)


def test_what_cannot_be_followed_with_it_says_nothing(asked):
    named, after, *_ = asked(0.0, lost=KEPT)
    assert len(after.windows) == TAUGHT and after.hypothesis.evidence == pytest.approx(named.hypothesis.evidence, rel=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_causes_that_are_alike_are_weighed_by_the_same_windows(monkeypatch, seed):
    """Drag was simulated, damping was not. By windows kept out drag alone had been weighed, and stood alone."""
    monkeypatch.setattr(refits, "compressed", lambda evidence, *_: [e.normals for e in evidence])
    monkeypatch.setattr(trials, "compressed", lambda evidence, *_: [e.normals for e in evidence])
    both = synthetic.windows(np.random.default_rng(seed), lambda k: {"air_normal_drag": 3.0}, count=TAUGHT + KEPT, n=60, alike=0.93)
    taught = both.only(range(TAUGHT))
    before = [SimpleNamespace(normals=n, prediction=SimpleNamespace(complete=True)) for n in both.given[TAUGHT:]]
    monkeypatch.setattr(refits, "_simulated", lambda *_: before)
    t = Trials.__new__(Trials)
    t.screened = Screened(None, (), None, taught, tuple(ranked(taught)))
    t.run, t.alike, t.vetoed, t.replayed, t._weighed = map, frozenset(), frozenset(), SimpleNamespace(something_missing=0.0), set()
    t.learnt, screened = (), t.screened
    named = next(h for h in t.screened.hypotheses if h.name == "air_normal_drag")
    t.after = {named.name: Refitted(named, None, (), taught, against=taught)}
    for _ in range(2):  # once is enough
        t.learn(None, before)
        for h in t.singles:
            assert h.evidence == pytest.approx(both.fit(h.effects).evidence, rel=0.02, abs=0.05)
    assert t.screened is screened  # what is reported of training windows, and what the next recording adds to, is theirs
