"""Blind prediction: what it starts from."""

from tasks.gap.blind import predicted
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
