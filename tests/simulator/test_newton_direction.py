"""Newton's directions against a dense solution, and when they are factorised for."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csc_matrix

from tasks.simulator import NO_COLLIDER, Cloth, Fabric, Settings
from tasks.simulator.base_model import base_problem
from tasks.simulator.linear_system import NotPositiveDefinite
from tasks.simulator.newton_direction import EARLY, LADDER, MOST, Directions, hessians, preconditioned, times
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


def dense(problem, step, x):
    A = problem.system.assemble(problem.hessians(x, step)).toarray()
    A = np.tril(A) + np.tril(A, -1).T
    return A, np.linalg.solve(A, -problem.system.gather(problem.gradient(x, step)))


def off(A, p, expected):
    """Relative error in the norm of A."""
    return np.sqrt((p - expected) @ A @ (p - expected) / (expected @ A @ expected))


def test_one_factor_serves_a_smooth_step(scene, monkeypatch):
    problem, step, x = scene
    directions, asked = Directions(problem.potentials, problem.system), counted(problem, monkeypatch)
    directions.newton(x, step, problem.gradient(x, step))
    y = x + problem.system.scatter(1e-4 * np.random.default_rng(1).normal(size=problem.system.size))
    p = problem.system.gather(directions.newton(y, step, problem.gradient(y, step)))
    A, expected = dense(problem, step, y)
    chord = np.linalg.solve(dense(problem, step, x)[0], A @ expected)  # what the kept factor alone would say
    assert len(asked) == 1
    assert off(A, p, expected) < 1e-3 < 10 * off(A, chord, expected)


def test_what_moves_of_itself_is_foreseen(scene):
    """By the first direction, which a factor gives, and by the second, which iterations do."""
    problem, step, x = scene
    directions, g = Directions(problem.potentials, problem.system), problem.gradient(x, step)
    fixed = np.zeros_like(x)
    fixed[problem.boundary] = [1e-3, 0.0, 2e-3]
    for _ in range(2):
        p = directions.answer(x, step, g, fixed, step.collider)
        after = g + times(problem.hessians(x, step), p, step.collider)
        np.testing.assert_allclose(p[problem.boundary], fixed[problem.boundary])
        assert np.abs(after[problem.system.free]).max() < 1e-3 * np.abs(g).max()


def test_what_moves_of_itself_is_answered_more_sharply(scene, monkeypatch):
    """By iterations: a share of centimetres is as much as a gap."""
    problem, step, x = scene
    directions, asked = Directions(problem.potentials, problem.system), counted(problem, monkeypatch)
    directions.newton(x, step, problem.gradient(x, step))
    y = x + problem.system.scatter(1e-4 * np.random.default_rng(1).normal(size=problem.system.size))
    g, fixed = problem.gradient(y, step), np.zeros_like(y)
    fixed[problem.boundary] = [1e-3, 0.0, 2e-2]
    p = problem.system.gather(directions.answer(y, step, g, fixed, step.collider))
    A, _ = dense(problem, step, y)
    expected = np.linalg.solve(A, -problem.system.gather(g + times(problem.hessians(y, step), fixed, step.collider)))
    assert len(asked) == 1 and off(A, p, expected) < 1e-5


def test_a_hessian_that_changed_much_is_factorised_anew_and_that_factor_serves(scene, monkeypatch):
    problem, step, x = scene
    directions, asked = Directions(problem.potentials, problem.system), counted(problem, monkeypatch)
    stiff = replace(step, s=1e-4 * step.s)  # a Hessian that is nearly all inertia
    for at in (stiff, step, step):
        p = problem.system.gather(directions.newton(x, at, problem.gradient(x, at)))
        np.testing.assert_allclose(p, dense(problem, at, x)[1], rtol=1e-6, atol=1e-12)
    assert len(asked) == 2


def test_negative_curvature_is_noticed(scene):
    """In one direction of many: iterations would end after two, at a saddle."""
    problem, step, x = scene
    A = problem.system.assemble(problem.hessians(x, step))
    factor, (whole, _) = problem.system.factorise(A), dense(problem, step, x)
    λ, v = np.linalg.eigh(whole)
    saddle = csc_matrix(np.tril(whole - 2 * λ[0] * np.outer(v[:, 0], v[:, 0])))
    b = v.sum(1)
    with pytest.raises(NotPositiveDefinite):
        preconditioned(saddle, b, factor, 1e-8)
    np.testing.assert_allclose(preconditioned(A, b, factor, 1e-8), np.linalg.solve(whole, b), rtol=1e-6)


def test_iterations_that_promise_to_take_too_long_are_broken_off(scene):
    problem, step, x = scene
    A, b = problem.system.assemble(problem.hessians(x, step)), -problem.system.gather(problem.gradient(x, step))
    other = problem.system.factorise(problem.system.assemble(problem.hessians(x, replace(step, s=1e-4 * step.s))))
    solved = []
    other.solve = lambda r, solve=other.solve: (solved.append(r), solve(r))[1]
    assert preconditioned(A, b, other, 1e-4) is None
    assert EARLY < len(solved) < MOST


def test_nothing_to_answer_is_no_curvature(scene):
    problem, step, x = scene
    A = problem.system.assemble(problem.hessians(x, step))
    assert not preconditioned(A, np.zeros(problem.system.size), problem.system.factorise(A), 1e-4).any()


def buckling(problem, step):
    """A place where H is not definite: the sheet squeezed a little, in a long step."""
    x = 0.99 * step.x_n + 1e-4 * np.random.default_rng(2).normal(size=step.x_n.shape)
    return replace(step, s=16 * step.s), x


def test_where_h_is_not_definite_a_factor_of_its_neighbour_serves(scene, monkeypatch):
    """The next iteration tries less convexity, is told of negative curvature without a factorisation, and goes downhill all the same."""
    problem, step, _ = scene
    step, x = buckling(problem, step)
    assert np.linalg.eigvalsh(dense(problem, step, x)[0]).min() < 0
    directions, asked = Directions(problem.potentials, problem.system), counted(problem, monkeypatch)
    g = problem.gradient(x, step)
    directions.newton(x, step, g)
    before = len(asked)
    p = directions.newton(x, step, g)
    assert before > 1 and len(asked) == before
    assert np.sum(g * p) < 0


def test_steps_that_end_at_a_velocity_go_along_convex_neighbours(scene):
    problem, step, x = scene
    g = problem.gradient(x, step)
    H = problem.system.assemble(hessians(problem.potentials, x, step, convex=True)).toarray()
    expected = np.linalg.solve(np.tril(H) + np.tril(H, -1).T, -problem.system.gather(g))
    exact, convex = (replace(problem, velocity_tolerance=v).directions().newton(x, step, g) for v in (0.0, 1e-3))
    np.testing.assert_allclose(problem.system.gather(convex), expected, rtol=1e-6, atol=1e-10)
    assert np.abs(exact - convex).max() > 1e-4 * np.abs(convex).max()


def test_convexity_is_taken_back_where_cloth_no_longer_buckles(scene):
    problem, step, x = scene
    directions = Directions(problem.potentials, problem.system)
    squeezed, y = buckling(problem, step)
    directions.newton(y, squeezed, problem.gradient(y, squeezed))
    for _ in LADDER:
        p = problem.system.gather(directions.newton(x, step, problem.gradient(x, step)))
    A, expected = dense(problem, step, x)
    assert off(A, p, expected) < 1e-3
