"""Blind prediction: what it starts from."""

from types import SimpleNamespace

import numpy as np
import pytest

from flows import gap
from tasks.effects.library import library
from tasks.gap.blind import held, predicted
from tasks.gap.residual import rms_mm
from tests.cloth.test_windows import swung


def test_noise_in_two_frames_hardly_reaches_the_prediction():
    """A prediction of the recording's own model, from two frames with 1 mm of noise: beyond the start it stays within a few times that."""
    model, recording, true, _ = swung(25, noise=1e-3)
    x = predicted(model, recording)
    assert rms_mm(x[2:] - true[2:]) < 4.0
    assert rms_mm(x[2:] - recording.observed[1]) > 20.0  # it moves


def test_without_noise_the_prediction_is_the_recording():
    model, recording, true, _ = swung(13)
    assert rms_mm(predicted(model, recording)[2:] - true[2:]) < 2.5


@pytest.mark.parametrize("name", ["fabric_rest_scale", "observation_scale"])
def test_shrunken_cloth_starts_where_it_was_seen(name):
    """By a base that does not know of 5 % the two frames are drawn out to the lengths of the pattern."""
    model, *_ = swung(13)
    effect = library()[name]
    shrunk = model.joined([effect], {name: np.array([-0.05])})
    _, recording, true, _ = swung(13, fabric=shrunk.dressed().fabric)
    x = predicted(shrunk, recording)
    assert rms_mm(x[:2] - true[:2]) < 1.0
    assert rms_mm(predicted(model, recording)[:2] - true[:2]) > 5.0


@pytest.mark.parametrize(("reached", "used"), [(4, "before"), (9, "after"), (12, "after")])
def test_a_cause_with_which_cloth_cannot_be_simulated_foretells_nothing(tmp_path, monkeypatch, reached, used):
    """Cloth held at the last state that was reached would be compared with what was seen as if that had been foretold."""
    told = {"before": np.full((9, 3, 3), 1.0), "after": np.full((reached, 3, 3), 2.0)}
    monkeypatch.setattr(gap, "_predicted", lambda job: told[job[0].name])
    before, after = (SimpleNamespace(name=name) for name in told)
    gap.BlindPrediction(SimpleNamespace(map=map), range(12)).write(tmp_path / "pred.npz", before, after)
    found = np.load(tmp_path / "pred.npz")
    assert np.array_equal(found["before"], held(told["before"], 12)) and np.array_equal(found["after"], held(told[used], 12))
