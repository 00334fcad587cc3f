"""The stress runs' figures and garments are what they claim, and one run of each difficulty goes through."""

import numpy as np
import pytest

from tasks.geometry.meshes import mesh_faults
from tests.simulator.stress import DRESS, EASE, build, examine, figure, names, penetration, surface_net, union


def test_sixty_runs():
    assert len(set(names())) == 60


@pytest.mark.parametrize("stout", [0.9, 1.0, 1.1])
def test_skin_lies_on_the_surface_and_looks_out(stout):
    bones = figure(stout)
    x, faces = surface_net(lambda x: union(bones, x), 0.03)
    assert not mesh_faults(x, faces, "skin") and np.abs(union(bones, x)).max() < 1e-4
    centre, n = x[faces].mean(1), np.cross(x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]])
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    assert np.mean(union(bones, centre + 0.01 * n) > union(bones, centre - 0.01 * n)) > 0.999


@pytest.mark.parametrize("garment", DRESS)
def test_garments_begin_off_the_skin(garment):
    bones = figure(1.0)
    x, faces, pins = DRESS[garment](bones)
    assert not mesh_faults(x, faces, garment) and len(pins) > 8 and 200 < len(x) < 800
    assert union(bones, x).min() > 0.8 * EASE


def test_pressed_arms_enter_the_body():
    case = build("cape", "press", 0)
    depth = [penetration(x, case.collider.faces) for x in case.collider_motion[[0, 9]]]
    assert depth[0] == 0 and depth[1] > 0.01


@pytest.mark.slow
@pytest.mark.parametrize("case", names()[::11])
def test_a_run_goes_through(case):
    outcome = examine(*case)
    assert outcome.ending == "converged" and not outcome.crossing and outcome.beyond <= 0
