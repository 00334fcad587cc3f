"""Frames that are left out change the rate, or are refused: an acceleration of known size comes out right by the rate of the selection."""

import numpy as np
import pytest

from tasks.capture.frame_rate import rate_of, rate_warnings, spacing_faults


@pytest.mark.parametrize("k", [1, 2, 5])
def test_a_falling_body_falls_by_g_however_many_frames_are_left_out(k):
    numbers = np.arange(3, 60, k)
    height = -0.5 * 9.81 * (numbers / 25) ** 2
    np.testing.assert_allclose(np.diff(height, 2) * rate_of(numbers, 25.0) ** 2, -9.81)
    assert spacing_faults(numbers, "here") == []


def test_consecutive_frames_keep_the_rate_to_the_last_bit_and_in_silence():
    for numbers in (np.arange(24), np.array([7])):
        assert rate_of(numbers, 29.97) == 29.97
        assert rate_warnings(numbers, 29.97) == []


def test_every_other_frame_is_told():
    assert rate_warnings(np.array([4, 6, 8]), 25.0) == [
        "The frames read stand 2 apart: 25 frames per second of consecutive numbers are 12.5 of these."
    ]


@pytest.mark.parametrize(
    ("numbers", "says"),
    [
        ([0, 1, 2, 4, 5, 8], "frame 4 follows frame 2, where others stand 1 apart"),
        ([0, 4, 8, 9], "frame 9 follows frame 8, where others stand 4 apart"),
        ([0, 3, 4, 5], "frame 3 follows frame 0, where others stand 1 apart"),
    ],
)
def test_the_first_gap_is_named(numbers, says):
    (fault,) = spacing_faults(np.array(numbers), "Sequence1/4x")
    assert fault.where == "Sequence1/4x"
    assert says in fault.what
    assert "stop at the gap" in fault.remedy
