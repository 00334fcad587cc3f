"""The answer has the same keys whatever the verdict: other programs read it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tasks.effects.library import library
from tasks.gap.answer import answer
from tasks.gap.diagnosis import RATIOS, diagnose
from tasks.gap.hypotheses import Fitted, Weight
from tasks.gap.verdict import Candidate, Verdict
from tests.cloth.test_windows import swung

DRAG = library()["air_normal_drag"]
NAMED = Fitted((DRAG,), np.zeros(2), np.eye(2), {DRAG.name: 5.0}, np.eye(1), np.ones(3), (Weight(1.0, 1.0, 1.0, 3.0, 0.0),))
UNNAMED = (Candidate(("none",), 0.5), Candidate(("outside_library",), 0.3))
RANKING = (*UNNAMED, Candidate((DRAG.name,), 0.2, NAMED))
FORM = {
    "version": None,
    "verdict": {"kind", "effects", "class", "probability", "sentence"},
    "ranking": None,
    "answer_set_90": None,
    "gap": {"before_mm", "after_mm", "floor_mm", "closed_fraction", "low", "high", "held_out"},
    "where": {"zones", "vertex_mm", "vertex_accel", "frame_mm"},
    "parameters": set(RATIOS),
    "record_next": None,
    "seconds": None,
}


@pytest.fixture(scope="module")
def untestable():
    """A diagnosis of a recording that is too short for one."""
    model, recording, *_ = swung(12, noise=1e-3)
    return diagnose(model, [recording], [DRAG], quick=True)


@pytest.mark.parametrize(
    "verdict",
    [
        None,
        Verdict("none", None, (), 0.5, RANKING),
        Verdict("outside_library", None, (), 0.3, RANKING),
        Verdict("effect", NAMED, ((DRAG.name,),), 0.2, RANKING),
    ],
    ids=["not_testable", "none", "outside_library", "effect"],
)
def test_every_kind_of_verdict_has_the_public_form(untestable, verdict):
    found = answer(untestable if verdict is None else replace(untestable, verdict=verdict), seconds=1.0)
    assert list(found) == list(FORM)
    assert {key: set(found[key]) for key, own in FORM.items() if own} == {key: own for key, own in FORM.items() if own}
    for ratio in found["parameters"].values():
        assert set(ratio) == {"value", "low", "high", "unit"}
    for row in found["ranking"]:
        assert set(row) == {"class", "probability", "strength"}
    assert {"none", "outside_library"} <= {n for row in found["ranking"] for n in row["class"]}
    json.dumps(found, allow_nan=False)
