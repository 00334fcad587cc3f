"""C-IPC's loop on scenes where its end is known otherwise."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.simulator import Cloth, Collider, Fabric, Settings, simulate
from tasks.simulator.cipc_newton import clamped
from tests.simulator.scenes import crosses, run, sheet, sphere, still

EXACT = Settings(integrator="backward_euler", substeps=1, yield_collider=False, newton_iterations=300)
CIPC = replace(EXACT, solver="cipc", velocity_tolerance=1e-3)


def test_negative_eigenvalues_are_cut_off():
    rng = np.random.default_rng(0)
    H = rng.normal(size=(6, 9, 9))
    H = H + H.transpose(0, 2, 1)
    H[3:] = H[3:] @ H[3:]
    H[5] = 0
    λ, v = np.linalg.eigh(H)
    np.testing.assert_allclose(clamped(H), (v * np.maximum(λ, 0)[:, None]) @ v.transpose(0, 2, 1), atol=1e-9 * np.abs(H).max())
    assert λ[:3].min() < -1


def test_without_saddles_it_ends_at_the_solution():
    """A sheet that swings from one edge: unique, so that only the tolerance is between the two."""
    x, faces = sheet(5, 4, length=0.3, width=0.2)
    cloth = Cloth(x, faces, np.arange(4))
    ends = {}
    for name, settings in {"exact": EXACT, "1e-3": CIPC, "1e-7": replace(CIPC, velocity_tolerance=1e-7)}.items():
        ends[name] = run(cloth, Fabric(membrane=4, bending=20), still(4, cloth), settings=settings)[-1].x
    tight, loose = (np.abs(ends[name] - ends["exact"]).max() for name in ("1e-7", "1e-3"))
    assert tight < 1e-5 and tight < loose < 1e-3


@pytest.mark.parametrize("rise", [1e-4, 0.03])
def test_a_collider_arrives_within_a_hundredth_of_its_way(rise):
    """It jumps when nothing is in its way and pulls the cloth along otherwise; nothing crosses."""
    x, faces = sheet(9, 9, length=0.4, width=0.4)
    ball, ball_faces = sphere(2, 0.1)
    cloth = Cloth(x - np.array([0.2, -0.102, 0.2]), faces)
    motion = np.stack([ball, ball + np.array([0, rise, 0])])
    motions = {"collider": Collider(ball_faces), "collider_motion": motion, "boundary_motion": np.zeros((2, 0, 3))}
    *_, frame = simulate(cloth, Fabric(), fps=25, settings=CIPC, **motions)
    assert frame.converged and not crosses(frame, cloth, ball_faces)
    way = (frame.collider - ball)[:, 1] / rise
    assert np.ptp(way) < 1e-9 and 0.99 <= way[0] <= 1 + 1e-9


def test_too_few_iterations_are_said():
    x, faces = sheet(5, 4, length=0.3, width=0.2)
    cloth = Cloth(x, faces, np.arange(4))
    settings = replace(CIPC, newton_iterations=4, halvings=0)
    *_, frame = simulate(cloth, Fabric(), fps=25, settings=settings, **still(3, cloth))
    assert not frame.converged and "after 4 iterations" in frame.ending
