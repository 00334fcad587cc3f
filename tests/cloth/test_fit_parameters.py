"""What no fit can be run with is refused where it is given, by name; what is not given follows from the frame rate."""

import pytest
from pydantic import ValidationError

from tasks.cloth.stage import FitParameters, TrackParameters


@pytest.mark.parametrize(
    "given",
    [
        *({name: bad} for name in ("density", "membrane", "bending") for bad in (0.0, -1.0, float("nan"), float("inf"))),
        *({name: bad} for name in ("substeps", "attempts", "iterations") for bad in (0, -1)),
        *({name: 0.0} for name in ("frame_s", "limit_s")),
        {"frames": 1},
        {"friction": -0.1},
    ],
)
def test_it_is_refused_by_name(given):
    (name,) = given
    with pytest.raises(ValidationError) as refused:
        TrackParameters(**given)
    assert [e["loc"] for e in refused.value.errors()] == [(name,)]


def test_the_least_that_can_be_asked_for_is_not():
    FitParameters(friction=0.0, frames=2, iterations=1, substeps=1, attempts=1)
    FitParameters(iterations=None)


@pytest.mark.parametrize("method", ["gauss-newton", "whole-replay", "adam-fd"])
def test_at_25_frames_per_second_24_are_compared_in_four_steps_each(method):
    parameters = FitParameters(method=method)
    assert (parameters.compared(25.0), parameters.settings(25.0).substeps) == (24, 4)


def test_at_other_rates_the_time_stays_the_same_and_what_is_given_wins():
    """Algorithm 1 counts its frames whatever they last."""
    assert (FitParameters().compared(120.0), FitParameters().settings(120.0).substeps) == (115, 1)
    assert (FitParameters().compared(10.0), FitParameters().settings(10.0).substeps) == (10, 10)
    given = FitParameters(frames=24, substeps=4)
    assert (given.compared(120.0), given.settings(10.0).substeps) == (24, 4)
    assert FitParameters(method="adam-fd").compared(120.0) == 24
