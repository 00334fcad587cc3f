"""What is counted in frames, from the frame rate: time steps of a frame, and frames to compare."""

import math

LONGEST_STEP = 0.01  # [s]
COMPARED_S = 0.96  # [s] 24 frames at 25 per second, as many as Algorithm 1 takes
FEWEST = 2  # frames after the first: with one there is a velocity and nothing that it changes to
EXACTLY = 1e-9  # of a step: 1/(25 · 0.01) is four steps, not five


def steps_per_frame(fps: float) -> int:
    """As few as are no longer than `LONGEST_STEP`."""
    return max(1, math.ceil(1 / (fps * LONGEST_STEP) - EXACTLY))


def frames_compared(fps: float) -> int:
    """As many after the first as last about `COMPARED_S`."""
    return max(FEWEST, round(COMPARED_S * fps))
