"""Assembly against a dense sum, Cholesky against numpy, and the fallback against both."""

import numpy as np
import pytest
from scipy.sparse import csc_matrix, random_array

from tasks.simulator import linear_system
from tasks.simulator.gravity import Gravity
from tasks.simulator.linear_system import LinearSystem, NotPositiveDefinite, _lu
from tasks.simulator.potential import Blocks


def blocks(rng, stencils):
    B = rng.normal(size=(len(stencils), 3 * stencils.shape[1], 3 * stencils.shape[1]))
    return Blocks(stencils, B @ B.transpose(0, 2, 1))


def dense(terms, vertices, free):
    A = np.zeros((3 * vertices, 3 * vertices))
    for term in terms:
        if isinstance(term, Blocks):
            A += term.times(np.eye(3 * vertices).reshape(-1, vertices, 3)).reshape(A.shape)
        else:
            A += term.toarray()[: len(A), : len(A)]
    rows = (3 * free[:, None] + np.arange(3)).ravel()
    return A[np.ix_(rows, rows)]


@pytest.fixture
def case():
    rng = np.random.default_rng(2)
    stencils = np.array([[0, 1, 2], [2, 1, 3], [3, 4, 2]], np.int32)
    system = LinearSystem(6, np.array([1]), [stencils])
    masses = Blocks(np.arange(6, dtype=np.int32)[:, None], np.tile(np.eye(3), (6, 1, 1)))
    G = random_array((24, 24), density=0.1, rng=rng)
    contact = csc_matrix(G @ G.T)  # cloth and two collider vertices, with pairs that no stencil has
    return system, [blocks(rng, stencils), masses, contact]


def test_assembly(case):
    system, terms = case
    expected = dense(terms, 6, system.free)
    np.testing.assert_allclose(np.tril(system.assemble(terms).toarray()), np.tril(expected), atol=1e-12)
    np.testing.assert_allclose(np.tril(system.assemble(terms[:2]).toarray()), np.tril(dense(terms[:2], 6, system.free)), atol=1e-12)


def test_a_term_may_bring_stencils_of_its_own(case):
    """As an effect from a user's folder may."""
    system, terms = case
    far = blocks(np.random.default_rng(3), np.array([[0, 3, 5], [5, 4, 2]], np.int32))
    terms = [*terms[:2], far]
    np.testing.assert_allclose(np.tril(system.assemble(terms).toarray()), np.tril(dense(terms, 6, system.free)), atol=1e-12)


def test_stencils_made_anew_are_not_kept(case):
    """As a term may that looks for its stencils in every iteration."""
    system, terms = case
    for _ in range(20):
        system.assemble([Blocks(term.stencils.copy(), term.values) for term in terms[:2]])
    assert len(system._known) == 4  # of the last two assemblies


def test_stencils_that_take_turns_are_found_once(case, monkeypatch):
    system, terms = case
    found, find = [], system._find
    monkeypatch.setattr(system, "_find", lambda stencils: (found.append(stencils), find(stencils))[1])
    for _ in range(5):
        system.assemble(terms[:1])
        system.assemble(terms[1:2])
    assert len(found) == 2


def test_gravity_brings_none():
    gravity = Gravity(np.ones(3))
    assert gravity.hessian(np.zeros((3, 3)), None, convex=False) is gravity.hessian(np.zeros((3, 3)), None, convex=True)


def test_solution(case):
    system, terms = case
    A, b = system.assemble(terms), np.random.default_rng(0).normal(size=(system.size, 2))
    expected = np.linalg.solve(dense(terms, 6, system.free), b)
    for factorise in (system.factorise, _lu):
        np.testing.assert_allclose(factorise(A).solve(b), expected, rtol=1e-9, atol=1e-12)


def test_many_right_hand_sides_are_solved_for_in_turn(case, monkeypatch):
    system, terms = case
    A = system.assemble(terms)
    b = np.random.default_rng(1).normal(size=(system.size, 11))
    monkeypatch.setattr(linear_system, "AT_ONCE", 4)
    np.testing.assert_allclose(system.factorise(A).solve(b), np.linalg.solve(dense(terms, 6, system.free), b), rtol=1e-9, atol=1e-12)


def test_indefinite_matrices_are_refused(case):
    system, terms = case
    low = np.linalg.eigvalsh(dense(terms, 6, system.free))[0]
    shift = Blocks(terms[1].stencils, -1.1 * low * terms[1].values)
    for factorise in (system.factorise, _lu):
        with pytest.raises(NotPositiveDefinite):
            factorise(system.assemble([*terms, shift]))
