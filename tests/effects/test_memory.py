"""Terms with a memory: when it moves, and what it remembers."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tasks.effects.fabric_bending_hysteresis import BendingFriction
from tasks.effects.fabric_shear_hysteresis import ShearFriction
from tasks.effects.internal_friction import InternalFriction
from tasks.simulator import Blocks, Cloth, Step, simulate
from tasks.simulator.potential import NO_STIFFNESS, Potential
from tests.effects.scenes import FPS, FRAMES, TIGHT, panel, struck, subject
from tests.simulator.scenes import sheet


class Diary(Potential):
    """Does nothing and writes down what it is told."""

    def __init__(self) -> None:
        self.begun, self.accepted, self.derived = [], [], []

    def energy(self, x, step):
        return 0.0

    def gradient(self, x, step):
        return np.zeros_like(x)

    def hessian(self, x, step, *, convex) -> Blocks:
        return NO_STIFFNESS

    def begin(self, x):
        self.begun.append(x)

    def accept(self, x, step):
        self.accepted.append((x, step))

    def accept_tangent(self, x, step, dx, d, names):
        assert dx.shape == d.x_n.shape == (len(names), *x.shape)
        self.derived.append((len(self.accepted), names))


def test_only_steps_that_are_kept_are_accepted_and_in_order():
    s, motion, x0, v0 = struck()
    diary = Diary()
    frames = list(
        simulate(
            s.cloth,
            s.fabric,
            s.collider,
            collider_motion=motion.collider,
            boundary_motion=motion.boundary,
            fps=FPS,
            x0=x0,
            v0=v0,
            settings=replace(TIGHT, newton_iterations=12),  # too few for the steps in which the ball strikes: they are halved
            potentials=(diary,),
            tangents=("log_bending",),
        )
    )
    assert frames[-1].converged and len(frames) == FRAMES
    steps = [step for _, step in diary.accepted]
    assert len(steps) > FRAMES - 1
    assert sum(step.h for step in steps) == pytest.approx((FRAMES - 1) / FPS)
    ends = [diary.begun[0], *(x for x, _ in diary.accepted)]
    assert len(diary.begun) == 1 and all(np.array_equal(step.x_n, end) for step, end in zip(steps, ends, strict=False))
    assert diary.derived == [(i, ("log_bending",)) for i in range(len(steps))]  # derivatives first


class Slider(InternalFriction):
    """One deformation: the height of the first vertex."""

    def __init__(self) -> None:
        super().__init__("slider", 2.0, np.array([3.0]), np.array([0.1]))

    def deformation(self, x):
        return x[:1, 1]

    def along(self, path: list[float]) -> list[float]:
        """z at each stop of a path."""
        self.begin(_at(path[0]))
        found = []
        for a, b in pairwise(path):
            self.accept(_at(b), _step(_at(a)))
            found.append(float(self.z[0]))
        return found


def _at(height: float) -> np.ndarray:
    return np.array([[0, height, 0.0]])


def _step(x: np.ndarray) -> Step:
    none = np.zeros((0, 3))
    return Step(0.01, 0.01, x, 0 * x, x, 0 * x, none, none, none)


def test_friction_knows_the_path_but_not_the_rate():
    up, down = list(np.linspace(0, 0.3, 30)), list(np.linspace(0.3, -0.1, 17))
    many, few = Slider().along(up + down[1:]), Slider().along([0, 0.3, -0.1])
    assert few == pytest.approx([many[28], many[-1]], rel=1e-12)
    assert few[0] == pytest.approx(1 - np.exp(-3)) and few[1] == pytest.approx(-1 + (few[0] + 1) * np.exp(-4))


def test_a_closed_loop_costs_energy():
    """Far around, four times the extent of the loop times the greatest moment: Coulomb friction."""
    slider, cost = Slider(), 0.0
    path = [0.0, 20.0, -20.0, 20.0]
    slider.begin(_at(0))
    for a, b in pairwise(path):
        step = _step(_at(a))
        cost = cost if a == 0 else cost + slider.energy(_at(b), step)
        slider.accept(_at(b), step)
    assert cost == pytest.approx(2 * 3 * (40 + 40), rel=0.01)


def test_cloth_that_stops_keeps_its_moment():
    slider = Slider()
    slider.along([0, 0.05])
    z = slider.z.copy()
    slider.accept(_at(0.05), _step(_at(0.05)))
    assert np.array_equal(slider.z, z) and z[0] == pytest.approx(1 - np.exp(-0.5))


def _cylinder(x: np.ndarray, curvature: float, along: int = 0) -> np.ndarray:
    """A flat sheet in x, z rolled up about z (along = 0) or x (2)."""
    across = 2 - along
    y = np.zeros_like(x)
    y[:, along], y[:, 1], y[:, across] = (
        np.sin(curvature * x[:, along]) / curvature,
        (1 - np.cos(curvature * x[:, along])) / curvature,
        x[:, across],
    )
    return y


@pytest.mark.parametrize("along", [0, 2])
def test_bending_friction_is_a_moment_per_width(along):
    """Rolling a sheet far up costs HB · curvature · area, whatever the direction of its edges."""
    x, faces = sheet(9, 7, length=0.4, width=0.3)
    friction = BendingFriction(subject(Cloth(x, faces), faces[:0]), "fabric_bending_hysteresis", 1.3e-3)
    friction.extent = friction.extent / 1000  # Coulomb's law at once
    rolled = _cylinder(x, 4.0, along)
    inner = 7 / 8 * 0.3 * 0.4 if along == 0 else 5 / 6 * 0.3 * 0.4  # the outermost strips have no hinge at their free edge
    friction.begin(x)
    assert friction.energy(rolled, _step(x)) == pytest.approx(1.3e-3 * 0.15 * 4.0 * inner, rel=0.02)


def test_shear_friction_is_a_stress_and_finds_the_weave_without_a_pattern():
    """Simple shear of a vertical panel far beyond γ_c costs HG γ area; stretch along weft or warp costs nothing."""
    for cloth in (panel(), replace(panel(), uv=None)):
        friction = ShearFriction(subject(cloth, np.zeros((0, 3), np.int32)), "fabric_shear_hysteresis", 3.3)
        x = cloth.x_rest
        friction.begin(x)
        sheared = x + 0.4 * x[:, 1:2] * np.array([1.0, 0, 0])
        exact = 3.3 * 0.15 * cloth.rest_areas.sum() * (0.4 - 5e-3)
        assert friction.energy(sheared, _step(x)) == pytest.approx(exact, rel=1e-6)
        assert friction.energy(x * np.array([1.1, 0.9, 1.0]), _step(x)) == pytest.approx(0, abs=1e-12)
