"""Whole recordings replayed: about one floor where nothing is missing, above it where a wind was left out, and what that says."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth.shooting import Job
from tasks.cloth.start_state import States, states
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import Window, predict, windows
from tasks.effects.library import library
from tasks.gap import replay
from tasks.gap.gathered import Gathered
from tasks.gap.replay import (
    Replay,
    Replayed,
    base_replays,
    mean,
    mean_normals,
    nearer,
    parted,
    replayed_by,
    replayed_by_each,
    replays,
    supported,
    weighted,
)
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
    assert mean(base_replays(model, (), data)).ratio2 < 2.0


def test_a_wind_that_the_model_lacks_shows_and_is_gone_once_it_is_added(blown):
    model, windy, data = blown
    base = base_replays(model, (), data)
    without, with_it = mean(base), mean(replayed_by(windy, base, data))
    assert without.ratio2 > 10 and with_it.ratio2 < 2.0, (without, with_it)
    assert supported(without, with_it) > 4
    assert with_it.apart == pytest.approx(without.gap, rel=0.3)  # the wind is all that is between the two replays


def test_the_yardstick_is_the_farther_of_two_replays(blown, monkeypatch):
    model, _, data = blown
    whole = mean(base_replays(model, (), data))
    near = replay._followed
    monkeypatch.setattr(replay, "_followed", lambda job: None if job[1] else near(job))
    own = mean(base_replays(model, (), data))
    monkeypatch.setattr(replay, "_followed", lambda job: None if job[2] == 1 else near(job))
    finer = mean(base_replays(model, (), data))
    assert own.floor != finer.floor and whole.floor > 0.99 * max(own.floor, finer.floor)  # frame by frame, under other weights
    monkeypatch.setattr(replay, "_followed", lambda job: None if job[2] is not None else near(job))
    assert np.isnan(mean(base_replays(model, (), data)).floor)


def test_states_from_other_errors_are_driven_as_the_whole_recording_is(monkeypatch):
    model, recording, x, v = swung(12)
    slip, asked = library()["boundary_slip"], []
    slipping = model.joined([slip], {slip.name: np.array([0.02, 0.1])})
    nothing = States(x[:0], v[:0], "stuck")
    monkeypatch.setattr(replay, "states", lambda model, motion, *_: asked.append(motion.boundary) or nothing)
    job = Job(slipping, recording, Window(0, 5, 4), States(x, v, "converged"), smooth_modes(model.subject.cloth, 2))
    assert replay._seen_otherwise(job, 0) is job
    assert np.array_equal(asked[0], slipping.driven(recording.motion).boundary[5:10])


def test_a_replay_starts_where_its_first_frames_ask_for():
    """States that are off by 40 mm/s along a smooth mode: a replay that believed them ends centimetres away."""
    model, recording, *_ = swung(25, noise=NOISE)
    data = gathered(model, recording)
    (walked,) = data.states
    φ = smooth_modes(model.subject.cloth, 1)[0]
    v = walked.v.copy()
    v[0, :, 2] += 0.04 * φ
    wrong = replace(data, states=(States(walked.x, v, walked.ending),))
    (job,) = replays(model, wrong)
    believed = predict(model, job.recording, job.window, job.states)
    off = np.nanmean(np.sum((recording.observed[1:] - believed.x[1:]) ** 2, -1))
    found, right = (mean(base_replays(model, (), d)).gap for d in (wrong, data))
    assert off > 2.5 * right and found < 1.5 * right, (off, found, right)


def test_derivatives_of_replays_foretell_what_adding_the_cause_does(blown, monkeypatch):
    """Both from the states themselves, for a start is corrected anew with the cause."""
    model, windy, data = blown
    monkeypatch.setattr(replay, "_well_started", lambda job: job)
    without = base_replays(model, [WIND], data)
    told, w = mean_normals(without), np.array([0.02, 0.0])
    little = replayed_by(replace(windy, strengths={WIND.name: w}), without, data)
    i = told.index(WIND.columns)
    foretold = told.c - 2 * told.g[i] @ w + w @ told.G[np.ix_(i, i)] @ w
    gained = told.c - mean(little).gap
    assert gained > 0.02 * told.c and told.c - foretold == pytest.approx(gained, rel=0.05)


def test_several_models_are_replayed_side_by_side_each_as_alone(blown):
    model, windy, data = blown
    base, asked = (*base_replays(model, (), data), None), []

    def run(function, jobs):
        asked.append(len(jobs))
        return map(function, jobs)

    data = replace(
        data, recordings=data.recordings * 2, states=data.states * 2, windows=(*data.windows, replace(data.windows[0], recording=1))
    )
    found = replayed_by_each([model, windy], base, data, run)
    assert asked == [2] and [each[1] for each in found] == [None, None]
    assert [each[0].replayed for each in found] == [replayed_by(m, base, data)[0].replayed for m in (model, windy)]


def test_a_replay_is_compared_in_any_window_that_it_passes_through(blown):
    model, _, data = blown
    few = data.only(data.windows[1::2])
    (whole,) = base_replays(model, (), few)
    boundary = model.subject.cloth.boundary
    own, floors = zip(*(whole.within(data.recordings[0], w, boundary) for w in few.windows), strict=True)
    assert all(whole.holds(w) for w in few.windows) and not whole.holds(data.windows[0])
    assert weighted(np.concatenate(own), np.concatenate(floors)) == pytest.approx(whole.replayed.gap, rel=0.2)
    assert np.isnan(own[0][:, boundary]).all()


def test_replays_that_cannot_be_finished_say_nothing(blown):
    model, _, data = blown
    nothing = mean([None])
    assert np.isnan(nothing.ratio2)
    assert np.isnan(mean(replayed_by(model, [None], data)).gap) and mean_normals([None]) is None
    assert nothing.something_missing == 0.0
    assert supported(nothing, Replayed(1e-6, 1e-6)) == supported(Replayed(1e-6, 1e-6), nothing) == 0.0


def test_each_frame_counts_over_its_own_floor():
    """Two millimetres off, then a metre where nobody can foretell anything: a cause that halves the first is seen."""
    floor = np.array([1e-6, 1e-6, 1.0])
    off = np.array([2e-3, 2e-3, 1.0])[:, None, None] * np.ones((3, 5, 3)) / 3**0.5
    w = (1 / floor) / np.sum(1 / floor)
    assert weighted(off, floor) == pytest.approx(w @ [4e-6, 4e-6, 1.0]) and weighted(off, floor) == pytest.approx(4e-6, rel=0.2)
    unseen = off.copy()
    unseen[:2, :4] = np.nan
    assert weighted(unseen, floor) > weighted(off, floor)  # of the first frames a fifth is left, of the last all
    base, found = (Replay(Replayed(1.0, 1.0), None, x, floor, None) for x in (np.zeros((4, 5, 3)), np.concatenate([off[:1], off])))
    assert parted([found, None], [base, base]) == pytest.approx(weighted(off, floor))


def test_what_lies_between_the_windows_is_not_looked_at(blown):
    model, _, data = blown
    few = data.only(data.windows[::2])
    hidden = data.windows[1].frames
    recording = few.recordings[0]
    observed = recording.observed.copy()
    observed[hidden][1:-1] += 1.0  # metres
    spoilt = replace(few, recordings=(replace(recording, observed=observed),))
    assert mean(base_replays(model, (), spoilt)) == mean(base_replays(model, (), few))


def test_a_hypothesis_is_supported_by_coming_nearer_as_far_as_it_moves_the_cloth():
    base = Replayed(9e-6, 2e-6)
    nearer, as_far, further = (supported(base, Replayed(gap, 2e-6, 9e-6)) for gap in (2e-6, 9e-6, 18e-6))
    assert nearer > 4 and as_far == 0.0 and further < -2
    assert supported(base, Replayed(2e-6, 2e-6, 1e-6, chance=1.5e-6)) == 0.0  # chance alone sets replays as far apart
    assert supported(base, Replayed(2e-6, 2e-6, 1e-6, chance=0.5e-6)) > 0.0  # the rest of the floor is noise, which sets no replays apart


def test_noise_is_of_the_floor_and_not_of_chance(blown):
    model, windy, data = blown
    base = base_replays(model, (), data)
    for whole in (mean(base), mean(replayed_by(windy, base, data))):
        assert 0 < whole.chance == pytest.approx(whole.floor - 3 * NOISE**2)


def test_of_two_that_come_far_nearer_the_one_that_leaves_less_is_supported_more():
    base = Replayed(100e-6, 1e-6)
    little, more, most = (supported(base, Replayed(gap, 1e-6, 100e-6)) for gap in (1e-6, 4e-6, 16e-6))
    assert 12.0 == little > more > most > 5.0


def test_what_is_at_the_floor_speaks_for_nothing_and_above_it_for_something():
    factors = [Replayed(r * 4e-6, 4e-6).something_missing for r in (0.5, 1.0, 1.5, 2.0, 3.0, 9.0)]
    assert all(a <= b for a, b in itertools.pairwise(factors))
    assert factors[1] < -1.5 and factors[-1] > 2.5


def test_replays_that_part_little_by_chance_are_the_surer_witnesses():
    calm, wild = (Replayed(8e-6, 4e-6, chance=share * 4e-6) for share in (0.1, 0.9))
    assert calm.something_missing > 2.5 > 0.5 > wild.something_missing
    named = [supported(base, replace(base, gap=4e-6, apart=8e-6)) for base in (calm, wild)]
    assert named[0] > 8 > 4 > named[1] > 0


def test_a_floor_of_centimetres_says_little():
    low, high = (Replayed(floor, floor).something_missing for floor in (4e-6, 9e-4))
    assert low < -1.5 and high > -0.8


def test_whoever_loses_a_recording_has_not_come_nearer():
    def of(*gaps):
        return [None if gap is None else Replay(Replayed(gap, 1e-6), None, np.zeros((1, 1, 3)), np.ones(0), None) for gap in gaps]

    assert nearer(of(2e-6, 8e-6), of(4e-6, 8e-6)) and not nearer(of(4e-6, 8e-6), of(2e-6, 8e-6))
    assert not nearer(of(2e-6, None), of(4e-6, 8e-6)) and nearer(of(2e-6, None), of(4e-6, None))
