"""The fabric of least unbalanced force is the one that moved the cloth, whatever one step says that stopped early."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.simulator import NO_COLLIDER, Cloth, Fabric, Settings
from tests.benchmarks import equation_error
from tests.benchmarks.equation_error import balances, fitted
from tests.simulator.scenes import free, run, sheet

FPS = 25.0
STEPS = Settings(integrator="backward_euler", substeps=1, acceleration_tolerance=1e-9)
TRUE, START = Fabric(320.0, 2.0, 30.0), Fabric(320.0, 4.0, 90.0)


@pytest.fixture(scope="module")
def swung():
    """A sheet that swings from one edge, its fabric known."""
    X, F = sheet(6, 5)
    cloth = Cloth(X, F, np.arange(5))
    still = free(8) | {"boundary_motion": np.tile(X[:5], (8, 1, 1))}
    return cloth, np.stack([f.x for f in run(cloth, TRUE, still, fps=FPS, settings=STEPS)])


def steps_of(cloth: Cloth, x: np.ndarray) -> list[equation_error.Balance]:
    return balances(cloth, START, NO_COLLIDER, x, np.zeros((len(x), 0, 3)), fps=FPS, settings=STEPS)


def test_it_finds_the_fabric_that_moved_the_cloth(swung):
    found = fitted(START, steps_of(*swung))
    assert (found.membrane, found.bending) == pytest.approx((TRUE.membrane, TRUE.bending), rel=1e-4)


def test_a_step_that_stopped_early_has_a_scale_of_its_own(swung):
    steps = steps_of(*swung)
    rng = np.random.default_rng(0)
    early = replace(steps[3], r=steps[3].r + 5 * rng.standard_normal(len(steps[3].r)))
    noisy = [replace(s, r=s.r + 1e-3 * rng.standard_normal(len(s.r))) for s in steps]
    found = fitted(START, [*noisy[:3], early, *noisy[4:]])
    assert (found.membrane, found.bending) == pytest.approx((TRUE.membrane, TRUE.bending), rel=0.01)


def test_weights_that_do_not_settle_are_no_answer(swung, monkeypatch):
    monkeypatch.setattr(equation_error, "ROUNDS", 1)
    with pytest.raises(RuntimeError, match="do not settle"):
        fitted(START, steps_of(*swung))
