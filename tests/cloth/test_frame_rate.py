"""Steps and frames at rates from slow to fast; at 25 per second as Algorithm 1 has them."""

import pytest

from tasks.cloth.frame_rate import LONGEST_STEP, frames_compared, steps_per_frame

RATES = (5.0, 10.0, 24.0, 25.0, 29.97, 30.0, 60.0, 100.0, 120.0, 240.0)


def test_at_25_frames_per_second_they_are_four_and_24():
    assert (steps_per_frame(25.0), frames_compared(25.0)) == (4, 24)


@pytest.mark.parametrize("fps", RATES)
def test_no_step_is_longer_than_promised_and_none_is_shorter_than_it_must_be(fps):
    n = steps_per_frame(fps)
    assert 1 / (fps * n) <= LONGEST_STEP * (1 + 1e-9)
    assert n == 1 or 1 / (fps * (n - 1)) > LONGEST_STEP


@pytest.mark.parametrize("fps", RATES)
def test_about_a_second_is_compared(fps):
    assert frames_compared(fps) / fps == pytest.approx(0.96, abs=0.5 / fps)


def test_two_frames_after_the_first_are_the_least():
    assert frames_compared(1.0) == 2
