"""Windows and whole recordings together: whichever knows, says."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.windows import Normals
from tasks.effects.library import library
from tasks.gap.hypotheses import FORM, Fitted
from tasks.gap.joint_estimate import degrees, disagreement, foretold, joint
from tasks.gap.replay import Replayed, supported

TILT = library()["gravity_tilt"]
NAMES = (*PARAMETERS, *TILT.columns)
WINDOWS = np.array([0.1, -0.1, 0.02, 0.0])
WHOLE = np.array([0.2, 0.3, 0.08, -0.03])
FORMS = np.diag((FORM * WINDOWS[2:]) ** 2)  # what windows say of strengths always holds that doubt
FLOOR = 4e-6  # m²


def off(gap):
    """Replays of a floor that is chance for the most part."""
    return Replayed(gap, FLOOR, chance=0.8 * FLOOR)


def fitted(sd):
    C = np.diag(np.full(4, sd) ** 2)
    return Fitted((TILT,), WINDOWS[:2], C[:2, :2], dict(zip(TILT.columns, WINDOWS[2:])), C[2:, 2:] + FORMS, np.zeros(1), ())


def told(about=0.0):
    """E(θ) = FLOOR + |J (θ − WHOLE)|² about some strengths, as `Replay.normals` has it."""
    J = np.random.default_rng(0).standard_normal((30, 4)) * [0.1, 0.1, 0.3, 0.3]
    G, δ = J.T @ J / 30, WHOLE - about
    return Normals(NAMES, G, G @ δ, float(FLOOR + δ @ G @ δ), 90)


def values(h):
    return np.concatenate([h.base, list(h.strengths.values())])


def test_where_windows_know_nothing_replays_say():
    np.testing.assert_allclose(values(joint(fitted(1e3), told(), off(FLOOR))), WHOLE, rtol=0.01)


def test_where_windows_are_sure_they_say():
    np.testing.assert_allclose(values(joint(fitted(1e-6), told(), off(FLOOR))), WINDOWS, atol=1e-6)


def test_replays_that_say_nothing_leave_what_windows_say():
    """With its uncertainty: priors are in it already, and so is the doubt about the form of the law."""
    h, nothing = fitted(0.3), replace(told(), G=np.zeros((4, 4)), g=np.zeros(4))
    found = joint(h, nothing, off(FLOOR))
    np.testing.assert_allclose(values(found), WINDOWS, rtol=1e-9)
    for mine, theirs in ((found.base_covariance, h.base_covariance), (found.covariance, h.covariance)):
        np.testing.assert_allclose(mine, theirs, rtol=1e-9)


def test_between_them_it_is_the_least_squares_of_both():
    n, sd = told(), np.array([0.1, 0.1, 0.01, 0.01])
    h = replace(fitted(1.0), base_covariance=np.diag(sd[:2] ** 2), covariance=np.diag(sd[2:] ** 2) + FORMS)
    L = np.linalg.cholesky(n.G * degrees(off(FLOOR)) / FLOOR)
    A = np.vstack([np.diag(1 / sd), L.T])
    b = np.concatenate([WINDOWS / sd, np.linalg.solve(L, n.g * degrees(off(FLOOR)) / FLOOR)])
    np.testing.assert_allclose(values(joint(h, n, off(FLOOR))), np.linalg.lstsq(A, b, rcond=None)[0], rtol=1e-6)


def test_the_first_step_lessens_what_they_disagree_by():
    """Where replays are quadratic the joint estimate is the least of Q with E₁ in its denominator: from E₁ it goes down, and its slope
    there is the same.
    """
    h = replace(fitted(0.1), base=np.zeros(2), strengths=dict.fromkeys(TILT.columns, 0.0), covariance=0.01 * np.eye(2))
    n = told()
    E = lambda θ: n.c - 2 * n.g @ θ + θ @ n.G @ θ  # noqa: E731
    Q = lambda θ: disagreement(replace(h, base=θ[:2], strengths=dict(zip(TILT.columns, θ[2:]))), h, off(E(θ)))  # noqa: E731
    assert Q(values(joint(h, n, off(n.c)))) < Q(np.zeros(4))
    slope = [(Q(1e-6 * e) - Q(-1e-6 * e)) / 2e-6 for e in np.eye(4)]
    np.testing.assert_allclose(slope, -n.g * degrees(off(n.c)) / n.c, rtol=1e-5)


def test_far_from_the_recording_replays_say_little():
    near, far = (values(joint(fitted(0.05), told(), off(gap))) for gap in (FLOOR, 1e4 * FLOOR))
    assert np.linalg.norm(far - WINDOWS) < 0.05 * np.linalg.norm(near - WINDOWS)


def test_replays_that_part_little_by_chance_say_more():
    wild, calm = (values(joint(fitted(0.05), told(), Replayed(FLOOR, FLOOR, chance=share * FLOOR))) for share in (0.9, 0.1))
    assert np.linalg.norm(calm - WHOLE) < 0.8 * np.linalg.norm(wild - WHOLE)


def test_about_strengths_that_were_simulated_it_is_the_same_answer():
    at = np.array([0.0, 0.0, 0.05, 0.01])
    origin = dict(zip(TILT.columns, at[2:]))
    np.testing.assert_allclose(
        values(joint(fitted(0.05), told(at), off(FLOOR), origin)), values(joint(fitted(0.05), told(), off(FLOOR))), rtol=1e-6
    )


def test_strengths_stay_within_their_range():
    high = np.array([s.high for s in TILT.strengths])
    beyond = replace(fitted(1e3), strengths=dict(zip(TILT.columns, 5 * high)), covariance=1e-12 * np.eye(2))
    assert (np.array(list(joint(beyond, told(), off(FLOOR)).strengths.values())) <= high + 1e-12).all()


def test_what_derivatives_foretell_is_weighed_as_a_replay_would_be():
    n = told()
    h, support = foretold(fitted(1e3), n, Replayed(n.c, FLOOR))
    θ = values(h)
    E = FLOOR + (θ - WHOLE) @ n.G @ (θ - WHOLE)
    assert support == pytest.approx(supported(Replayed(n.c, FLOOR), Replayed(E, FLOOR, θ @ n.G @ θ))) and support > 5
    assert foretold(fitted(1e-6), n, Replayed(n.c, FLOOR))[1] < support


def test_beside_what_is_simulated_already_it_is_weighed_against_that():
    at = np.array([0.0, 0.0, 0.05, 0.01])
    n, origin = told(at), dict(zip(TILT.columns, at[2:]))
    h, support = foretold(fitted(1e3), n, Replayed(n.c, FLOOR), origin)
    δ = values(h) - at
    E = FLOOR + (values(h) - WHOLE) @ n.G @ (values(h) - WHOLE)
    assert support == pytest.approx(supported(Replayed(n.c, FLOOR), Replayed(E, FLOOR, δ @ n.G @ δ))) and support > 1
