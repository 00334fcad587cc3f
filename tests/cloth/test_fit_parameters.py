"""What no fit can be run with is refused where it is given, by name."""

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
