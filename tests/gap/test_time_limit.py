"""A computation of a whole recording may take longer than one of a window."""

from tasks.gap.time_limit import time_limit

FPS = 30.0


def test_the_limit_grows_with_the_longest_recording_and_is_never_that_of_less_than_a_second():
    assert time_limit(600.0, [range(90), range(300), range(40)], FPS) == 6000.0
    assert time_limit(600.0, [range(9)], FPS) == 600.0
