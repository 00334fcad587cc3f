"""A whole case, as the diagnosis gets it."""

import json

import numpy as np
import pytest

from tasks.capture.tracked_geometry import tracked_geometry
from tasks.exam.generator.making import make, make_once
from tasks.exam.generator.strata import Question, drawn, questions
from tasks.exam.generator.subject import Unmakeable


@pytest.mark.slow
def test_a_case_is_readable_reproducible_and_of_the_magnitude_asked():
    question = Question(0, "single", {"gravity_tilt": 4.0}, None, "", "skirt", ("sway", "turn", "walk"), (5, 0))
    made = make(question)
    for arrays in (*made.recordings, made.blind, made.held_out):
        track = tracked_geometry({k: np.asarray(v) for k, v in arrays.items()}, name="case")
        assert 200 < len(track.rest_vertices) < 500 and len(track.vertices) == 40
    hidden = np.setdiff1d(np.arange(len(track.rest_vertices)), made.blind["boundary"])
    assert np.isnan(made.blind["vertices"][2:, hidden]).all()
    assert made.blind["vertices"][:2] == pytest.approx(made.held_out["vertices"][:2])
    assert 1.0 <= made.truth["multiple"] < 8
    json.dumps(made.truth)
    assert make(question).truth == made.truth


@pytest.mark.slow
def test_a_cause_that_moves_nothing_on_the_fine_mesh_is_not_asked_for():
    """A sleeve that only its coarse mesh lets touch the arm: a delay of the arm was asked for, and moved the recorded run by nothing."""
    question = drawn(questions(24, 202)[0], 3)
    assert question.kind == "sleeve" and list(question.causes) == ["observation_delay"]
    with pytest.raises(Unmakeable, match="on the fine mesh its causes move it by"):
        make_once(question, np.random.default_rng([*question.seed, 3, 1]))
