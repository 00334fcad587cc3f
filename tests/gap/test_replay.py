"""Whole recordings replayed: about one floor where nothing is missing, above it where a wind was left out, and what that says."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth.start_state import states
from tasks.cloth.windows import windows
from tasks.effects.library import library
from tasks.gap.gathered import Gathered
from tasks.gap.replay import Replayed, base_replays, mean, replayed_by
from tests.cloth.test_windows import FPS, swung

NOISE = 1e-3
WIND = library()["air_wind"]


def gathered(model, recording):
    walked = states(model, recording.motion, recording.observed, NOISE)
    return Gathered((recording,), (walked,), tuple(windows([recording], FPS)))


@pytest.fixture(scope="module")
def blown():
    """A panel recorded in a wind that its model does not know, once the wind's onset is over, and the model that does."""
    model, recording, x, v = swung(31, noise=NOISE)
    windy = replace(model, effects=(WIND,), strengths={WIND.name: np.array([1.0, 0.0])})
    y = np.stack([f.x for f in windy.run(recording.motion, x[0], v[0])])
    ε = NOISE * np.random.default_rng(3).standard_normal(y.shape)
    return model, windy, gathered(model, replace(recording, observed=y + ε).cut(slice(6, None)))


def test_a_replay_of_the_model_itself_stays_at_its_floor():
    model, recording, *_ = swung(25, noise=NOISE)
    data = gathered(model, recording)
    assert mean(base_replays(model, data)).ratio2 < 2.0


def test_a_wind_that_the_model_lacks_shows_and_is_gone_once_it_is_added(blown):
    model, windy, data = blown
    base = base_replays(model, data)
    without, with_it = mean(base).ratio2, mean(replayed_by(windy, base, data)).ratio2
    assert without > 10 and with_it < 2.0, (without, with_it)


def test_replays_that_cannot_be_finished_say_nothing(blown):
    model, _, data = blown
    assert np.isnan(mean([None]).ratio2)
    assert replayed_by(model, [None], data) == [None]
    assert mean([None]).something_missing == 0.0


def test_what_is_at_the_floor_speaks_for_nothing_and_above_it_for_something():
    factors = [Replayed(r * 4e-6, 4e-6).something_missing for r in (0.5, 1.0, 1.5, 2.0, 3.0, 9.0)]
    assert all(a <= b for a, b in itertools.pairwise(factors))
    assert factors[1] < -1.5 and factors[-1] > 2.5


def test_a_floor_of_centimetres_says_little():
    low, high = (Replayed(floor, floor).something_missing for floor in (4e-6, 9e-4))
    assert low < -1.5 and high > -0.8
