"""Newton's directions against a dense solution, and how much convexity they take on."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.simulator import NO_COLLIDER, Cloth, Fabric, Settings
from tasks.simulator.base_model import base_problem
from tasks.simulator.newton_direction import LADDER, hessians, times
from tasks.simulator.time_integration import State, known, rule
from tests.simulator.scenes import sheet

SIZE = 7


@pytest.fixture
def scene():
    """A problem, a step of it, and a place on the way, in a sheet that hangs by a side."""
    cloth = Cloth(*sheet(SIZE, SIZE, length=0.3, width=0.3), np.arange(SIZE))
    problem = base_problem(cloth, Fabric(), NO_COLLIDER, np.zeros((0, 3)), settings=Settings())
    rng = np.random.default_rng(0)
    now = State(cloth.x_rest, 0.1 * rng.normal(size=cloth.x_rest.shape), np.zeros((0, 3)))
    step = known(rule("backward_euler", 0.01, None), now, now, now.collider, 0.01)
    x = cloth.x_rest + 1e-4 * rng.normal(size=cloth.x_rest.shape)
    x[cloth.boundary] = cloth.x_rest[cloth.boundary]
    return problem, step, x


def counted(problem, monkeypatch):
    """The matrices that the system is asked to factorise."""
    asked, factorise = [], problem.system.factorise
    monkeypatch.setattr(problem.system, "factorise", lambda A: (asked.append(A), factorise(A))[1])
    return asked


def symmetric(problem, step, x, *, convex):
    """The Hessian, or its convex neighbour, on the free nodes."""
    A = problem.system.assemble(hessians(problem.potentials, x, step, convex=convex)).toarray()
    return np.tril(A) + np.tril(A, -1).T


def dense(problem, step, x):
    """The Hessian and Newton's direction."""
    A = symmetric(problem, step, x, convex=False)
    return A, np.linalg.solve(A, -problem.system.gather(problem.gradient(x, step)))


def test_a_direction_is_newton_s(scene):
    problem, step, x = scene
    p = problem.system.gather(problem.directions().newton(x, step, problem.gradient(x, step)))
    np.testing.assert_allclose(p, dense(problem, step, x)[1], rtol=1e-6, atol=1e-12)


def test_what_moves_of_itself_is_foreseen(scene):
    """What the direction leaves of the forces, to first order: nothing."""
    problem, step, x = scene
    g, fixed = problem.gradient(x, step), np.zeros_like(x)
    fixed[problem.boundary] = [1e-3, 0.0, 2e-3]
    p = problem.directions().answer(x, step, g, fixed, step.collider)
    after = g + times(problem.hessians(x, step), p, step.collider)
    np.testing.assert_allclose(p[problem.boundary], fixed[problem.boundary])
    assert np.abs(after[problem.system.free]).max() < 1e-9 * np.abs(g).max()


def buckling(problem, step):
    """A place where H is not definite: the sheet squeezed a little, in a long step."""
    x = 0.99 * step.x_n + 1e-4 * np.random.default_rng(2).normal(size=step.x_n.shape)
    return replace(step, s=16 * step.s), x


def test_where_h_is_not_definite_the_least_convexity_that_makes_it_so_is_taken_on(scene, monkeypatch):
    """One rung after another, and the direction goes downhill; the next iteration begins one rung lower."""
    problem, step, _ = scene
    step, x = buckling(problem, step)
    H, H_convex = (symmetric(problem, step, x, convex=convex) for convex in (False, True))
    least = next(i for i, λ in enumerate(LADDER) if np.linalg.eigvalsh((1 - λ) * H + λ * H_convex).min() > 0)
    directions, asked, g = problem.directions(), counted(problem, monkeypatch), problem.gradient(x, step)
    p = directions.newton(x, step, g)
    assert least > 0 and len(asked) == least + 1
    assert np.sum(g * p) < 0
    directions.newton(x, step, g)
    assert len(asked) == least + 3


def test_steps_that_end_at_a_velocity_go_along_convex_neighbours(scene):
    problem, step, x = scene
    g = problem.gradient(x, step)
    expected = np.linalg.solve(symmetric(problem, step, x, convex=True), -problem.system.gather(g))
    exact, convex = (replace(problem, velocity_tolerance=v).directions().newton(x, step, g) for v in (0.0, 1e-3))
    np.testing.assert_allclose(problem.system.gather(convex), expected, rtol=1e-6, atol=1e-10)
    assert np.abs(exact - convex).max() > 1e-4 * np.abs(convex).max()


def test_convexity_is_taken_back_where_cloth_no_longer_buckles(scene):
    problem, step, x = scene
    directions = problem.directions()
    squeezed, y = buckling(problem, step)
    directions.newton(y, squeezed, problem.gradient(y, squeezed))
    for _ in LADDER:
        p = problem.system.gather(directions.newton(x, step, problem.gradient(x, step)))
    np.testing.assert_allclose(p, dense(problem, step, x)[1], rtol=1e-6, atol=1e-12)
