"""What to record next: the separation foretold against fits, against simulation, and what is said of it."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.base_refit import summed
from tasks.cloth.nuisances import without_forcing, without_state
from tasks.cloth.shooting import Job, follow
from tasks.cloth.start_state import States
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import Window
from tasks.effects.air_linear_drag import EFFECT as LINEAR
from tasks.effects.air_normal_drag import EFFECT as NORMAL
from tasks.effects.body_lag import EFFECT as LAG
from tasks.effects.observation_delay import EFFECT as DELAY
from tasks.gap.gathered import gather
from tasks.gap.hypotheses import Fitted, Weight
from tasks.gap.next_motions import NextMotion, next_motions
from tasks.gap.next_recording import AGAIN, MORE, NOW, STILL, Design, designs, in_question, record_next, separation
from tasks.gap.screening import screen
from tasks.gap.strength_priors import precision
from tasks.gap.verdict import Candidate, Verdict
from tests.cloth.test_windows import FPS, swung


def single(effect, θ, dispersion=1.0) -> Fitted:
    weight = Weight(1.0, dispersion, dispersion, 1.0, 0.0)
    strengths = dict(zip(effect.columns, np.atleast_1d(θ), strict=True))
    return Fitted((effect,), np.zeros(2), np.eye(2), strengths, np.eye(len(strengths)), np.ones(3), (weight,))


def verdict(kind, classes=(), ranking=()):
    return Verdict(kind, None, classes, 0.5, tuple(Candidate(names, p) for names, p in ranking))


def test_separation_is_what_the_best_rival_fit_leaves():
    """Against least squares: what base and rival, held by their priors, make of a's signature."""
    S = np.random.default_rng(0).normal(size=(50, 4))
    S[:, 3] += 2 * S[:, 2]
    names, θ = [*PARAMETERS, *LINEAR.columns, *NORMAL.columns], 1.3
    for rival, others in ((NORMAL, [0, 1, 3]), (None, [0, 1])):
        held = np.sqrt(precision([rival] if rival else []))
        A = np.vstack([S[:, others], np.diag(held)])
        y = np.concatenate([θ * S[:, 2], np.zeros(len(others))])
        left = y - A @ np.linalg.lstsq(A, y, rcond=None)[0]
        found = separation(S.T @ S, names, single(LINEAR, θ, dispersion=4.0), rival)
        assert found == pytest.approx(np.linalg.norm(left) / 2)  # φ = 4


def test_a_faint_cause_is_compared_at_its_typical_strength():
    S = np.random.default_rng(1).normal(size=(50, 3))
    names, typical = [*PARAMETERS, *LINEAR.columns], float(LINEAR.typical[0])
    told = [separation(S.T @ S, names, single(LINEAR, θ), None) for θ in (0.0, 0.01 * typical, typical, 2 * typical)]
    assert told[0] == told[1] == told[2] == pytest.approx(told[3] / 2)


def test_what_undoes_one_another_is_parted_by_nothing():
    """A late body is an early garment: columns that differ in their sign."""
    S = 1e3 * np.random.default_rng(2).normal(size=(50, 3))
    S = np.column_stack([S, -S[:, 2]])
    names, lag = [*PARAMETERS, *LAG.columns, *DELAY.columns], single(LAG, 0.03)
    assert separation(S.T @ S, names, lag, None) > 100
    assert separation(S.T @ S, names, lag, DELAY) < 0.5  # what the rival's prior says against it


@pytest.fixture(scope="module")
def screened():
    model, recording, *_ = swung(31, noise=1e-3)
    data = gather(model, [recording])
    return screen(model, data, [NORMAL, LINEAR], iterations=0), data


def test_a_cause_that_nothing_rivals_asks_for_no_motion(screened):
    s, data = screened
    assert designs(s, s.base.model, data, [single(NORMAL, NORMAL.typical)], or_none=False) == ()
    assert designs(s, s.base.model, data, [], or_none=True) == ()


def test_designs_add_to_what_is_known_and_the_best_comes_first(screened):
    s, data = screened
    asked = [single(e, e.typical) for e in (NORMAL, LINEAR)]
    now, *others = designs(s, s.base.model, data, asked, or_none=False)
    assert now.said == NOW and [d.apart for d in others] == sorted((d.apart for d in others), reverse=True)
    assert all(d.apart > now.apart - 1e-9 for d in others) and others[0].apart > 1.2 * now.apart
    told = {d.said: d.apart for d in others}
    # a sheet that hangs still tells nothing of air
    assert told["the first pose held still"] == pytest.approx(now.apart, rel=0.02)
    again = 2 * FPS / sum(w.length for w in data.windows)
    assert told[AGAIN] == pytest.approx(now.apart * np.sqrt(1 + again), rel=0.05)


def test_a_first_recording_that_could_not_be_followed_is_passed_over(screened):
    """It has states of no frame, and its first one had been asked for."""
    s, data = screened
    asked = [single(e, e.typical) for e in (NORMAL, LINEAR)]
    stuck = States(data.states[0].x[:0], data.states[0].v[:0], "frame 0: cloth cannot be freed")
    windows = tuple(replace(w, recording=1) for w in data.windows)
    both = replace(data, recordings=data.recordings * 2, states=(stuck, *data.states), windows=windows)
    assert designs(s, s.base.model, both, asked, or_none=False) == designs(s, s.base.model, data, asked, or_none=False)


def test_a_motion_that_is_soon_over_is_compared_as_far_as_it_lasts(screened):
    """Thirty frames at twice the speed are fifteen: one window of ten."""
    s, data = screened
    long = data.cut(0.33, FPS)
    assert {w.length for w in long.windows} == {10}
    asked = [single(NORMAL, NORMAL.typical)]
    told = {d.said: d.apart for d in designs(s, s.base.model, long, asked, or_none=True)}
    assert told["the same motion at twice the speed"] > told[NOW] and "the same motion at half the speed" in told


def test_what_is_foretold_happens(screened):
    """The sheet is simulated in air through a next motion; what base and the rival then leave of it is d² again."""
    s, data = screened
    states, length, base = data.states[0], 5, s.base.model
    (asked,) = (m for m in next_motions(data.recordings[0], states.x[0], states.v[0], 16, FPS) if "aside" in m.said)
    θ, names = 0.5 * NORMAL.typical, [*PARAMETERS, *NORMAL.columns, *LINEAR.columns]
    foretold, found = (_equations(s, base, asked, air, length, data.recordings[0]) for air in (None, {NORMAL.name: θ}))
    d = separation(summed(foretold, names)[0], names, single(NORMAL, θ), LINEAR)
    rest = [*PARAMETERS, *LINEAR.columns]
    G, g = summed(found, rest)
    left = sum(n.c for n in found) - g @ np.linalg.solve(G + np.diag(precision([LINEAR])), g)
    assert np.sqrt(left) == pytest.approx(d, rel=0.15)


def _equations(s, base, asked: NextMotion, air, length, like):
    """Of two windows of the motion: observed is the cloth without air (None), or in air; each starts where that cloth is."""
    real = base if air is None else base.joined([NORMAL], air)
    frames = list(real.run(asked.motion, asked.x0, asked.v0))
    x, v = np.stack([f.x for f in frames]), np.stack([f.v for f in frames])
    recording = replace(like, motion=asked.motion, observed=x, noise=np.full(x.shape[:2], 1e-3))
    φ, model = smooth_modes(base.subject.cloth, 40), base.joined([NORMAL, LINEAR], {})
    found = []
    for start in (length, 2 * length):
        job = Job(model, recording, Window(0, start, length), States(x, v, ""), φ, columns=True, forced=True)
        found.append(without_forcing(without_state(follow(job).normals, s.prior), s.windows.forcing))
    return found


def test_in_question_are_the_named_and_what_is_needed_for_nine_tenths():
    singles = [single(e, e.typical) for e in (NORMAL, LINEAR, LAG, DELAY)]
    named = verdict("effect", (("air_linear_drag",),), [(("air_linear_drag",), 0.8), (("none",), 0.15), (("body_lag",), 0.05)])
    assert [h.name for h in in_question(named, singles)] == ["air_linear_drag"]
    doubtful = verdict("none", (), [(("none",), 0.5), (("air_normal_drag", "body_lag"), 0.3), (("outside_library",), 0.2)])
    assert [h.name for h in in_question(doubtful, singles)] == ["air_normal_drag", "body_lag"]


def test_it_is_said_in_words():
    pair = ("air_lift", "air_wind")
    told = [Design(NOW, 1.26, pair), Design("the first pose held still", 4.14, pair), Design(AGAIN, 2.0, pair)]
    assert record_next(verdict("effect"), told) == (
        "the first pose held still, for 2 seconds: it would part air_lift from air_wind by 4.1 standard deviations (now 1.3)"
    )
    assert "nothing that was tried parts air_lift from air_wind" in record_next(verdict("effect"), [told[0], told[2]])
    assert record_next(verdict("none"), ()) == MORE
    assert record_next(verdict("not_testable"), ()) == STILL
