"""C-IPC's recorded frames are solutions of our equations in its settings: Newton's method started there hardly moves.

And its Newton loop, followed from the frame before, ends where it ended after as many iterations.
"""

from dataclasses import replace

import numpy as np
import pytest

from tasks.simulator.base_model import base_problem
from tasks.simulator.newton import minimise
from tasks.simulator.time_integration import State, known, rule
from tests.benchmarks.digits import share_done
from tests.benchmarks.simulator import AS_CIPC, DATA, LIKE_CIPC, one_step, recording, restored_step, step_of

pytestmark = pytest.mark.skipif(not DATA.exists(), reason="no recordings: set PHYSAVATAR_REAL_DATA")


def distance(name, k, **fabric_changes):
    """Rms distance [mm] between frame k+1 and the solution of our step from frames k−1, k that Newton finds from there."""
    cloth, fabric, collider, x, c = recording(name)
    problem = base_problem(cloth, replace(fabric, **fabric_changes), collider, c[k], settings=AS_CIPC)
    now = State(x[k], (x[k] - x[k - 1]) * 25, c[k])
    step = known(rule("backward_euler", 0.04, None), now, now, c[k + 1], 0.04)
    return 1e3 * np.sqrt(np.mean(np.sum((minimise(problem, x[k + 1], step).x - x[k + 1]) ** 2, 1)))


@pytest.mark.parametrize(("name", "k"), [("skirt_base", 14), ("sphere_1600", 16), ("skirt_friction_04", 12)])
def test_a_frame_is_a_solution(name, k):
    assert distance(name, k) < 0.2


@pytest.mark.parametrize(
    ("name", "k", "change"),
    [("skirt_base", 14, {"membrane": 2.0}), ("skirt_base", 14, {"density": 480.0}), ("skirt_friction_04", 12, {"friction": 0.2})],
)
def test_and_of_no_other_fabric(name, k, change):
    assert distance(name, k, **change) > 0.2


@pytest.mark.parametrize(("name", "k", "iterations"), [("skirt_base", 6, 25), ("sphere_1600", 5, 18)])
def test_the_path_ends_where_it_ended(name, k, iterations):
    frame, end = step_of(name, k, LIKE_CIPC), recording(name)[3][k + 1]
    assert frame.newton_iterations == iterations
    assert 1e3 * np.sqrt(np.mean(np.sum((frame.x - end) ** 2, 1))) < 0.002


def test_with_its_digits_restored_the_start_is_known(monkeypatch, tmp_path):
    """From rest our step rounds to what C-IPC wrote, in nearly every number; so the next ends nearer than from the record."""
    monkeypatch.setenv("PHYSAVATAR_CACHE", str(tmp_path))
    first = restored_step("sphere_1600", 0)
    assert first["newton"] == first["theirs"]
    known = np.array(first["x"]) != recording("sphere_1600")[3][1]
    assert known.mean() > 0.9
    assert restored_step("sphere_1600", 1)["path"] < 0.7 * one_step("sphere_1600", 1)["path"]


def test_the_share_of_the_way_that_prescribed_nodes_went():
    """Of the recording, and of a way whose share is known."""
    c = recording("skirt_base")[4]
    assert share_done(c[0], c[6], c[7]) == pytest.approx(0.99088, abs=2e-5)
    turn = np.array([[0.96, 0, 0.28], [0, 1, 0], [-0.28, 0, 0.96]])
    assert share_done(c[0], c[0], c[0] + 0.994 * (c[0] @ turn.T - c[0])) == pytest.approx(0.994, abs=1e-4)
