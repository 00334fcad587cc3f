"""Motion with closed forms: free flight, oscillators under each rule, orders of convergence, invariances."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.simulator import Blocks, Cloth, Collider, Fabric, Potential, Settings
from tasks.simulator.newton import Solution
from tasks.simulator.simulate import SOLVERS
from tasks.simulator.time_integration import rule
from tests.simulator.scenes import free, plane, run, sheet, sphere, still

PLAIN = Fabric()
EXACT = Settings(integrator="bdf2", substeps=2, acceleration_tolerance=1e-8)


def test_free_flight_keeps_momentum():
    x, faces = sheet(5, 5, length=0.2, width=0.2)
    cloth, fabric = Cloth(x, faces), Fabric()
    m = fabric.areal_density * cloth.vertex_areas
    v0 = np.random.default_rng(0).normal(size=x.shape)
    frames = run(cloth, fabric, free(6), settings=replace(EXACT, gravity=(0, 0, 0)), v0=v0)
    p = np.array([m @ f.v for f in frames])
    np.testing.assert_allclose(p, np.tile(p[0], (6, 1)), atol=1e-9 * np.abs(p).max())
    assert np.abs(frames[-1].v - v0).max() > 0.1  # while the parts did move against one another


def test_fall():
    """Backward Euler falls g h² n(n+1)/2, the trapezoid of no rule; BDF2 converges to ½ g t²."""
    x, faces = sheet(2, 2, length=0.1, width=0.1)
    cloth = Cloth(x, faces)
    euler = run(cloth, Fabric(), free(6), settings=replace(EXACT, integrator="backward_euler", substeps=1))[-1].x
    np.testing.assert_allclose(euler[:, 1], -9.81 * 0.04**2 * 15, rtol=1e-9)
    fine = run(cloth, Fabric(), free(6), settings=replace(EXACT, substeps=16))[-1].x
    np.testing.assert_allclose(fine[:, 1], -9.81 * 0.2**2 / 2, rtol=1e-3)  # backward Euler errs by 1.2e-2 there


class Spring(Potential):
    """½ m ω² |x − x̄|² on every node: a rigid cloth becomes a linear oscillator."""

    def __init__(self, cloth, fabric, ω):
        self.k, self.centre = (fabric.areal_density * cloth.vertex_areas * ω**2)[:, None], cloth.x_rest

    def energy(self, x, step):
        return 0.5 * float(np.sum(self.k * (x - self.centre) ** 2))

    def gradient(self, x, step):
        return self.k * (x - self.centre)

    def hessian(self, x, step, *, convex):
        return Blocks(np.arange(len(x), dtype=np.int32)[:, None], self.k[:, :, None] * np.eye(3))


def amplification(integrator, ωh):
    """Largest root of the rule applied to y' = iωy."""
    return 1 / (1 - 1j * ωh) if integrator == "backward_euler" else max(np.roots([1.5 - 1j * ωh, -2, 0.5]), key=abs)


@pytest.mark.parametrize(
    ("integrator", "substeps", "kept"),
    [("backward_euler", 1, 0.464), ("backward_euler", 4, 0.822), ("bdf2", 1, 0.979), ("bdf2", 4, 0.9996)],
)
def test_swing_decays_as_the_rule_damps(integrator, substeps, kept):
    cloth, fabric, ω = Cloth(*sheet(2, 2)), Fabric(), 2 * np.pi
    settings = replace(EXACT, integrator=integrator, substeps=substeps, gravity=(0, 0, 0))
    x0 = cloth.x_rest + np.array([0.1, 0, 0])
    frames = run(cloth, fabric, free(51), settings=settings, potentials=(Spring(cloth, fabric, ω),), x0=x0)
    late = [f.x[0, 0] + 1j * f.v[0, 0] / ω for f in (frames[25], frames[50])]  # the parasitic root has died out by then
    assert abs(late[1] / late[0]) == pytest.approx(abs(amplification(integrator, ω * 0.04 / substeps)) ** (25 * substeps), rel=1e-4)
    assert abs(late[1] / late[0]) == pytest.approx(kept, abs=2e-3)


@pytest.mark.parametrize(("integrator", "order"), [("backward_euler", 1), ("bdf2", 2)])
def test_order_of_convergence(integrator, order):
    x, faces = sheet(4, 2, length=0.3, width=0.1)
    cloth, fabric = Cloth(x, faces, np.array([0, 1])), Fabric(membrane=0.05, bending=1)
    ends = [
        run(cloth, fabric, still(4, cloth), settings=replace(EXACT, integrator=integrator, substeps=n), v0=0 * x)[-1].x for n in (8, 16, 32)
    ]
    rate = np.log2(np.linalg.norm(ends[0] - ends[1]) / np.linalg.norm(ends[1] - ends[2]))
    assert rate == pytest.approx(order, abs=0.3)


@pytest.mark.parametrize(("growth", "is_euler"), [(1.0, False), (2.0, False), (2.5, True), (8.0, True)])
def test_a_step_that_grows_by_more_than_two_is_backward_euler(growth, is_euler):
    now, euler = rule("bdf2", growth * 0.01, 0.01), rule("backward_euler", growth * 0.01, 0.01)
    assert (now == euler) == is_euler


def test_an_impact_within_halved_steps_adds_no_energy(monkeypatch):
    """A stiff patch meets the ground in the last eighth of a step; the whole step after it had thrown it up at five times its speed."""
    solve = SOLVERS["exact"]
    failed = []

    def only_in_eighths(problem, x, step, **more):
        if abs(step.time - 0.04) < 1e-9 and step.h > 0.00126:
            failed.append(step.h)
            return Solution(x, "forced", 0, np.inf)
        return solve(problem, x, step, **more)

    monkeypatch.setitem(SOLVERS, "exact", only_in_eighths)
    x, faces = sheet(3, 3, length=0.05, width=0.05)
    ground, ground_faces = plane(4.0)
    cloth = Cloth(x + np.array([0.2, 0.0274, -0.6]), faces)
    fabric = Fabric(friction=0.0, bending=1000)
    m = fabric.areal_density * cloth.vertex_areas
    settings = Settings(acceleration_tolerance=1e-6)
    scene = still(3, cloth, (ground, ground_faces))
    frames = run(cloth, fabric, scene, settings=settings, v0=np.tile([0, -0.5, 0], (9, 1)))
    E = [0.5 * m @ np.sum(f.v**2, 1) + 9.81 * m @ f.x[:, 1] for f in frames]
    assert len(failed) == 3 and len(frames) == 3
    assert max(E[1:]) < E[0]


def rubbing():
    """A sheet dropped on a turning sphere: every base term at work."""
    x, faces = sheet(7, 7, length=0.3, width=0.3)
    ball, ball_faces = sphere(1, 0.1)
    turn = [np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]]) for a in np.linspace(0, 0.4, 7)]
    motion = np.stack([ball @ R.T for R in turn])
    return x - np.array([0.15, -0.102, 0.15]), faces, motion, ball_faces


def ride(x, faces, motion, ball_faces, fabric=PLAIN, settings=EXACT):
    return run(
        Cloth(x, faces),
        fabric,
        {"collider": Collider(ball_faces), "collider_motion": motion, "boundary_motion": np.zeros((len(motion), 0, 3))},
        settings=settings,
    )[-1].x


def test_gauge():
    """(ρ, κ_s, κ_b) → c (ρ, κ_s, κ_b) leaves the motion as it is, contact and friction included."""
    scene = rubbing()
    one, two = ride(*scene, Fabric()), ride(*scene, Fabric(density=640, membrane=2, bending=2))
    np.testing.assert_allclose(one, two, atol=1e-8)
    assert np.abs(one - ride(*scene, Fabric(density=640))).max() > 1e-5


def test_rigid_motion_and_relabelling():
    x, faces, motion, ball_faces = rubbing()
    base = ride(x, faces, motion, ball_faces)
    c, s = np.cos(0.7), np.sin(0.7)
    R, t = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]), np.array([0.3, -0.2, 0.5])
    np.testing.assert_allclose(ride(x @ R.T + t, faces, motion @ R.T + t, ball_faces), base @ R.T + t, atol=1e-7)
    order = np.random.default_rng(0).permutation(len(x))
    place = np.argsort(order)
    np.testing.assert_allclose(ride(x[order], place[faces].astype(np.int32), motion, ball_faces), base[order], atol=1e-7)


def test_same_input_same_bits():
    scene = rubbing()
    assert ride(*scene).tobytes() == ride(*scene).tobytes()


@pytest.mark.parametrize(("degrees", "friction"), [(30, 0.2), (30, 0.0), (5, 0.2)])
def test_incline(degrees, friction):
    """A small sheet on an incline slides at g (sin α − μ cos α), or stays."""
    α = np.radians(degrees)
    ground, ground_faces = plane(4.0, slope=-α)
    x, faces = sheet(3, 3, length=0.05, width=0.05)
    lift = x + np.array([0.2, 0.75e-3, -0.6])  # beside the diagonal of the ground
    c, s = np.cos(-α), np.sin(-α)
    lift = lift @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T
    cloth = Cloth(lift, faces)
    frames = run(
        cloth, Fabric(friction=friction, bending=1000), still(12, cloth, (ground, ground_faces)), settings=replace(EXACT, substeps=4)
    )
    down = np.array([np.cos(α), -np.sin(α), 0])
    v = [f.v.mean(0) @ down for f in frames]
    if friction > np.tan(α):
        assert abs(v[-1]) < 1e-3  # creeps below ε_v
    else:
        assert (v[-1] - v[-6]) / 0.2 == pytest.approx(9.81 * (np.sin(α) - friction * np.cos(α)), rel=0.02)
