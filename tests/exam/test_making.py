"""A whole case, as the diagnosis gets it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tasks.capture.tracked_geometry import tracked_geometry
from tasks.exam.generator.causes import CAUSES
from tasks.exam.generator.garments import cut, tailor
from tasks.exam.generator.making import NEARLY, make, make_once
from tasks.exam.generator.rehearsal import least, rehearsed, rms, still_run, strength
from tasks.exam.generator.stepper import Stepper
from tasks.exam.generator.strata import Question, drawn, questions
from tasks.exam.generator.subject import TooFaint, Unmakeable, drawn_subject, states

SKIRT = Question(0, "single", {"body_lag": 4.0}, (), "", "skirt", ("sway", "turn", "walk"), (5, 0))


def test_the_rest_shape_that_is_handed_out_lies_on_the_surface_it_is_cut_for():
    """Interpolated on the flat triangles of the finer mesh it would have wrinkles of half a millimetre, which the recordings do not."""
    garment = tailor(cut("sleeve", np.random.default_rng(3)), 260, 2.1, np.random.default_rng(4))
    radius = np.linalg.norm(garment.coarse.rest[:, 1:], axis=1)
    assert radius == pytest.approx(radius[0], abs=1e-12)
    assert rms(garment.tracked(garment.fine.rest) - garment.coarse.rest) < 0.1e-3


@pytest.mark.parametrize("late", [-0.1, 0.0, 0.1])
def test_a_recording_begins_with_cloth_that_hung_still_on_a_body_that_stood_still(late):
    """A body that is recorded late has moved already when the recording begins; settled against its motion, cloth would ride on a conveyor belt."""
    subject = drawn_subject(SKIRT, np.random.default_rng(0), vertices=120)
    base = subject.conditions(subject.garment.coarse)
    stepper = Stepper(subject.world(replace(base, body_late=late), 0))
    start, unmoved = subject.still(stepper, 0), subject.still(Stepper(subject.world(base, 0)), 0)
    assert start.t == min(-late, 0.0) and not start.v.any()
    assert rms(start.x - unmoved.x) < 1e-6  # it settles on the same body, whatever the lag
    found = list(states(stepper, start, frames=3))
    assert [state.t for state in found] == pytest.approx([0, 1 / 30, 2 / 30])
    assert np.array_equal(stepper.world.pose(0.0)[1], subject.scenes[0].pose(late)[1])


def test_a_cause_without_strength_moves_a_rehearsal_by_nothing():
    """Both runs hang still on their own mesh first: held against the fine mesh's drape, the faintest cause seemed to move the cloth."""
    subject = drawn_subject(replace(SKIRT, causes={"air_lift": 4.0}), np.random.default_rng(1), vertices=120)
    plain = still_run(subject, subject.conditions(subject.garment.coarse))
    assert rehearsed(subject, CAUSES["air_lift"], 0.0, plain) == 0
    assert rehearsed(subject, CAUSES["air_lift"], 5.0, plain) > 1e-4


def test_strengths_stay_within_what_is_plausible_and_say_how_far_that_goes():
    cause = CAUSES["gravity_tilt"]  # moves by 1 m per rad here
    assert strength(cause, abs, 0.05, 0.04, -1.0) == pytest.approx(-0.05)
    assert strength(cause, abs, 0.12, 0.05, 1.0) == cause.most == 0.09
    with pytest.raises(TooFaint) as found:
        strength(cause, abs, 0.12, 0.1, 1.0)
    assert found.value.share == pytest.approx(0.09 / 0.12)


def test_what_a_draw_must_reach():
    assert [least(m, NEARLY) for m in (1.0, 2.0, 8.0)] == pytest.approx([1.0, 1.6, 6.4])
    assert [least(m, 0.0) for m in (0.5, 1.0, 8.0)] == [0.5, 1.0, 1.0]


def test_draws_that_show_what_was_asked_come_first_then_the_one_that_shows_most():
    shares = {0: 0.3, 1: 0.6, 2: 0.5, 3: None, 4: 0.2, 5: 0.1, 6: 0.1, 7: 0.1}  # None: cannot be simulated
    asked = []

    def once(q, rng, share):
        attempt = next(k for k in range(8) if rng.bit_generator.state == np.random.default_rng([5, 0, k, 1]).bit_generator.state)
        asked.append((attempt, share))
        if shares[attempt] is None:
            raise ArithmeticError("chaos")
        if shares[attempt] < share:
            raise TooFaint("too faint", shares[attempt])
        return attempt or "the first"

    assert make(SKIRT, once) == 1
    assert asked == [*((k, NEARLY) for k in range(8)), (1, 0.0)]
    shares[2], asked[:] = 0.9, []
    assert make(SKIRT, once) == 2 and len(asked) == 3


@pytest.mark.slow
def test_a_case_is_readable_reproducible_and_of_the_magnitude_asked():
    question = Question(0, "single", {"gravity_tilt": 4.0}, (), "", "skirt", ("sway", "turn", "walk"), (5, 0))
    made = make(question)
    for arrays in (*made.recordings, made.blind, made.held_out):
        track = tracked_geometry({k: np.asarray(v) for k, v in arrays.items()}, name="case")
        assert 200 < len(track.rest_vertices) < 500 and len(track.vertices) == 40
    hidden = np.setdiff1d(np.arange(len(track.rest_vertices)), made.blind["boundary"])
    assert np.isnan(made.blind["vertices"][2:, hidden]).all()
    assert made.blind["vertices"][:2] == pytest.approx(made.held_out["vertices"][:2])
    assert 2.5 <= made.truth["multiple"] < 6
    json.dumps(made.truth)
    assert make(question).truth == made.truth


@pytest.mark.slow
def test_a_cause_that_moves_nothing_on_the_fine_mesh_is_not_asked_for():
    """A sleeve that only its coarse mesh lets touch the arm: a delay of the arm was asked for, and moved the recorded run by nothing."""
    question = drawn(questions(24, 202)[0], 3)
    assert question.kind == "sleeve" and list(question.causes) == ["observation_delay"]
    with pytest.raises(Unmakeable):
        make_once(question, np.random.default_rng([*question.seed, 3, 1]), 0.0)
