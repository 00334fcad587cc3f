"""Newton's directions against a dense solution, and how much convexity they take on."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.simulator import NO_COLLIDER, Cloth, Fabric, Settings, newton, newton_direction
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


def test_a_kept_factor_gives_newton_s_direction_until_something_is_learnt(scene, monkeypatch):
    """And then one that answers what the gradient did along a step with that very step (the secant equation)."""
    problem, step, x = scene
    directions, g = problem.directions(), problem.gradient(x, step)
    directions.newton(x, step, g)
    assert directions.again(g) is None  # a small one is cheap
    monkeypatch.setattr(newton_direction, "LARGE", 0)
    directions = problem.directions()
    assert directions.again(g) is None  # there is no factor yet
    p, asked = directions.newton(x, step, g), counted(problem, monkeypatch)
    np.testing.assert_allclose(directions.again(g), p, rtol=1e-9, atol=1e-15)
    for share in (1.0, 0.3):
        dg = problem.gradient(x + share * p, step) - g
        directions.learn(share * p, dg)
        np.testing.assert_allclose(directions.again(-dg), share * p, rtol=1e-6, atol=1e-12)
    directions.learn(p, -dg)  # no curvature: forgotten
    np.testing.assert_allclose(directions.again(-dg), share * p, rtol=1e-6, atol=1e-12)
    assert not asked
    directions.newton(x, step, g)
    np.testing.assert_allclose(directions.again(g), p, rtol=1e-9, atol=1e-15)  # a new factor begins anew
    convex = replace(problem, velocity_tolerance=1e-3).directions()
    convex.newton(x, step, g)
    assert convex.again(g) is None


def test_factors_that_serve_again_spare_others_and_end_nearer(scene, monkeypatch):
    """From crumpled cloth, where Newton's own steps leave a third of the residual each."""
    problem, step, _ = scene
    n, x = problem.system.free, step.x_n.copy()
    x[n] += 0.02 * np.random.default_rng(0).normal(size=(len(n), 3))
    always = newton.minimise(problem, x, step)
    monkeypatch.setattr(newton_direction, "LARGE", 0)
    often = newton.minimise(problem, x, step)
    assert often.converged and always.converged and often.residual < newton.FURTHER * problem.tolerance
    assert often.iterations < 0.75 * always.iterations
    assert np.abs(often.x - always.x).max() < 1e-6
