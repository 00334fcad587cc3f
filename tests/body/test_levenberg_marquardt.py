import numpy as np
import pytest
from scipy.optimize import minimize, rosen

from tasks.body.levenberg_marquardt import minimise


def rosenbrock(z):
    r = np.array([10 * (z[1] - z[0] ** 2), 1 - z[0]])
    J = np.array([[-20 * z[0], 10.0], [-1.0, 0.0]])
    return float(r @ r), 2 * J.T @ r, 2 * J.T @ J


def test_it_finds_the_valley_floor_as_scipy_does():
    found = minimise(rosenbrock, rosen, np.array([-1.2, 1.0]), tolerance=1e-14)
    assert found.converged
    assert found.z == pytest.approx(minimize(rosen, [-1.2, 1.0], method="BFGS").x, abs=1e-4)


def test_a_quadratic_takes_a_handful_of_steps():
    A = np.diag([1.0, 100.0, 1e4])
    found = minimise(lambda z: (1 + float(z @ A @ z), 2 * A @ z, 2 * A), lambda z: 1 + float(z @ A @ z), np.ones(3))
    assert found.steps <= 6
    assert np.abs(found.z).max() < 1e-3


def test_unknowns_that_nothing_depends_on_stay():
    H = np.diag([2.0, 0.0])
    found = minimise(lambda z: ((z[0] - 1) ** 2, np.array([2 * (z[0] - 1), 0]), H), lambda z: (z[0] - 1) ** 2, np.array([0.0, 7.0]))
    assert found.z == pytest.approx([1, 7], abs=1e-4)


def test_too_few_steps_are_admitted():
    found = minimise(rosenbrock, rosen, np.array([-1.2, 1.0]), steps=3)
    assert not found.converged
    assert "stopped at 3 steps" in found.ending
