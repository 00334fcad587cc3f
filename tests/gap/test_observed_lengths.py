"""The scale that observed lengths ask for, whatever errors of tracking add to them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tasks.cloth.tracking_noise import Correlation
from tasks.effects.library import library
from tasks.gap import refits
from tasks.gap.hypotheses import Fitted
from tasks.gap.observed_lengths import DOUBT, LEAST, SCALES, observed_scale
from tests.cloth.test_windows import swung

NOISE = 4e-3


@pytest.fixture(scope="module")
def panel():
    """A panel that swings, without noise."""
    model, recording, *_ = swung(13)
    return model, recording


def _seen(recording, scale, share, rng, noise=NOISE, told=None):
    """At another scale, with errors of which all vertices share so much of the variance, and are told to."""
    y = recording.observed * (1 + scale)
    shared, own = rng.standard_normal(y[:, :1].shape), rng.standard_normal(y.shape)
    errors = np.sqrt(share) * shared + np.sqrt(1 - share) * own
    correlation = Correlation(share if told is None else told, length=100.0)
    return replace(recording, observed=y + noise * errors, noise=np.full(y.shape[:2], noise), correlation=correlation)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("scale", [-0.05, 0.04])
def test_a_wrong_scale_is_found_from_below(panel, scale, share):
    model, recording = panel
    found = observed_scale(model, [_seen(recording, scale, share, np.random.default_rng(0))])
    doubt = DOUBT * 3 * NOISE**2 / 0.4**2 * 36  # of edges of 1/6 of the panel: half of 6σ²/length²
    assert np.sign(found) == np.sign(scale) and abs(scale) - doubt - 0.004 < abs(found) < abs(scale) + 0.004


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_nothing_is_claimed_of_what_noise_or_a_stretch_may_be(panel, share):
    model, recording = panel
    for scale in (0.0, 0.7 * LEAST):
        assert observed_scale(model, [_seen(recording, scale, share, np.random.default_rng(0))]) == 0.0


@pytest.mark.parametrize("told", [0.4, 0.6])
def test_nothing_is_claimed_where_the_share_is_slightly_off(panel, told):
    model, recording = panel
    seen = _seen(recording, 0.0, 0.5, np.random.default_rng(0), noise=20e-3, told=told)  # lengths err by 2.5 % for that
    assert observed_scale(model, [seen]) == 0.0


def test_vertices_that_were_not_seen_are_left_out(panel):
    model, recording = panel
    seen = _seen(recording, 0.04, 1.0, np.random.default_rng(0))
    y = seen.observed.copy()
    y[:, ::3] = np.nan
    assert observed_scale(model, [replace(seen, observed=y)]) == pytest.approx(observed_scale(model, [seen]), abs=2e-3)
    assert observed_scale(model, [replace(seen, observed=np.full_like(y, np.nan))]) == 0.0


@pytest.mark.parametrize("left_out", [(), SCALES[:1], SCALES])
def test_one_of_the_class_is_proposed_within_its_range(monkeypatch, left_out):
    effects = [e for name, e in library().items() if name in (*SCALES, "gravity_tilt") and name not in left_out]
    hypotheses = [Fitted((e,), np.zeros(2), np.eye(2), dict.fromkeys(e.columns, 0.1), np.eye(1), np.zeros(1), ()) for e in effects]
    screened = SimpleNamespace(hypotheses=hypotheses, base=SimpleNamespace(model=None))
    for s in (0.03, 9.0, 0.0):
        monkeypatch.setattr(refits, "observed_scale", lambda model, recordings, s=s: s)
        proposed = refits.by_length(screened, SimpleNamespace(compared=tuple))
        assert [h.name for h in proposed] == ([name for name in SCALES if name not in left_out][:1] if s else [])
        for h in proposed:
            (most,) = (r.high for r in h.effects[0].strengths)
            assert list(h.strengths.values()) == [min(s, most)]
