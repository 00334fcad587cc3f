"""The air of C-IPC's recording is the law that its author states."""

import numpy as np
import pytest

from tasks.simulator import Cloth, Fabric
from tasks.simulator.potential import Step
from tests.simulator.cipc_air import LaggedAir

H, AIR, ACROSS, ALONG = 0.04, 1.2, 1.5, 0.05


def test_a_face_is_held_back_by_the_speeds_of_the_step_before():
    rng = np.random.default_rng(0)
    x = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.2, 0]])
    cloth, fabric, nothing = Cloth(x, np.array([[0, 1, 2]], np.int32), np.empty(0, np.int32)), Fabric(), np.empty((0, 3))
    u, v = rng.normal(size=(2, 3))
    step = Step(H, H, x, np.tile(u, (3, 1)), x, np.tile(u, (3, 1)), nothing, nothing, nothing)
    air = LaggedAir(cloth, fabric, step.v_n, across=ACROSS, along=ALONG)
    moved = x + H * v
    n, area = np.array([0, 0, 1.0]), 0.01
    u_n, v_n = u @ n, v @ n
    force = -0.5 * AIR * area * (ACROSS * abs(u_n) * v_n * n + ALONG * np.linalg.norm(u - u_n * n) * (v - v_n * n))
    assert air.gradient(moved, step) == pytest.approx(np.tile(-force / 3, (3, 1)), rel=1e-12)
    assert air.energy(moved, step) == pytest.approx(-0.5 * H * force @ v, rel=1e-12)
    H_air = air.hessian(moved, step, convex=False).values[0]
    d = rng.normal(size=(3, 3))
    change = air.gradient(moved + 1e-3 * d, step) - air.gradient(moved, step)
    assert (H_air @ (1e-3 * d.ravel())).reshape(3, 3) == pytest.approx(change, rel=1e-9)
