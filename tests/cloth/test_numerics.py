"""What the computation alone does: laws by their tangents are what simulating with them would say, and every way is integrated out."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth.base_refit import scaled
from tasks.cloth.gauss_newton import Normal
from tasks.cloth.numerics import FINER, LINEAR, WAYS, common_error, corrected, offsets, otherwise, with_tangents
from tasks.cloth.shooting import Job, follow
from tasks.cloth.start_state import States
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import Normals, Window, predict
from tests.cloth.test_windows import swung

WINDOW = Window(0, 2, 5)


@pytest.fixture(scope="module")
def scene():
    model, recording, x, v = swung(12)
    return model, recording, States(x, v, "converged")


@pytest.mark.parametrize("way", LINEAR, ids=lambda way: way.name)
def test_the_tangent_of_another_law_is_what_simulating_with_it_changes(scene, way):
    model, recording, states = scene
    tangent = predict(with_tangents(model), recording, WINDOW, states, columns=True).columns[way.name]
    own, other = (predict(m, recording, WINDOW, states).x[1:] for m in (model, otherwise(model, way)))
    changed = other - own
    assert np.linalg.norm(tangent - changed) < 0.02 * np.linalg.norm(changed) and np.abs(changed).max() > 1e-7


def test_every_way_is_a_column_and_none_is_left_when_they_are_integrated_out(scene):
    model, recording, states = scene
    job = Job(with_tangents(model), recording, WINDOW, states, smooth_modes(model.subject.cloth, 4), columns=True)
    plain = follow(job)
    found = follow(replace(job, offsets=offsets(job, plain.prediction.x)))
    assert set(WAYS) - {"numerics_contact"} <= set(found.normals.names)  # nothing is touched
    assert not set(WAYS) & set(corrected(found.normals).names)


def test_a_finer_computation_moves_one_parameter_by_its_share_of_the_offset():
    """One column J, offsets D: c = J·D/J·J, by hand."""
    J, D = np.array([3.0, 0.0, 4.0]), np.array([1.0, 7.0, 2.0])
    assert common_error([window(J, D)], ["κ"]) == pytest.approx((11 / 25) ** 2)


def test_what_errs_alike_in_all_windows_does_not_shrink_with_their_number():
    """Their scatter does, and Student's quantile with it; the normal one of the common error stays."""
    J, D = np.array([3.0, 0.0, 4.0]), np.array([1.0, 7.0, 2.0])
    few, many = (interval([window(J, D)] * count) for count in (2, 200))
    assert few.common == pytest.approx(many.common) and few.covariance > 10 * (many.covariance - many.common)
    assert few.half_width > many.half_width == pytest.approx(1.645 * 11 / 25, rel=0.05)


def test_windows_that_err_in_opposite_ways_have_nothing_in_common():
    J, D = np.array([3.0, 0.0, 4.0]), np.array([1.0, 7.0, 2.0])
    assert common_error([window(J, D), window(J, -D)], ["κ"]) == pytest.approx(0)
    assert common_error([replace(window(J, D), names=("κ", "λ"))], ["κ"]) == 0  # no column of a finer computation


def window(J, D):
    """A window of one parameter and the offset of a finer mesh, residual zero beside the offset."""
    A = np.column_stack([J, D])
    return Normals(("κ", FINER[0].name), A.T @ A, A.T @ D, float(D @ D), len(J))


def interval(each):
    told = [scaled(corrected(n)) for n in each]
    return Normal(np.stack([n.g for n in told]), np.stack([n.G for n in told]), common_error(each, ["κ"]))
