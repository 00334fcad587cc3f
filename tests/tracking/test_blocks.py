"""Block assembly and conjugate gradients against dense linear algebra."""

import numba
import numpy as np
import pytest

from tasks.tracking import blocks


@pytest.fixture
def system():
    """A positive definite system on random triangles and edges, and the same matrix added up entry by entry."""
    rng = np.random.default_rng(0)
    V = 40
    triangles = np.array([rng.choice(V, 3, replace=False) for _ in range(60)])
    edges = np.array([rng.choice(V, 2, replace=False) for _ in range(50)])
    terms, A, b = [], np.zeros((V, 3, V, 3)), np.zeros((V, 3))
    for corners in (triangles, edges):
        n, k = corners.shape
        J, g = rng.standard_normal((n, 5, k, 3)), rng.standard_normal((n, k, 3))
        H = np.einsum("nria,nrjb->nijab", J, J)
        terms.append((g, H))
        for e in range(n):
            for i in range(k):
                b[corners[e, i]] += g[e, i]
                for j in range(k):
                    A[corners[e, i], :, corners[e, j], :] += H[e, i, j]
    diagonal = rng.uniform(0.5, 1, V)
    A[np.arange(V), :, np.arange(V), :] += diagonal[:, None, None] * np.eye(3)
    fast = blocks.assemble(blocks.pattern(V, triangles, edges), terms, diagonal=diagonal)
    return fast, A.reshape(3 * V, 3 * V), b


def test_assembly_adds_every_element_once(system):
    fast, A, b = system
    assert np.allclose(blocks.dense(fast), A, rtol=0, atol=1e-12)
    assert np.allclose(fast.gradient, b, rtol=0, atol=1e-12)


def test_conjugate_gradients_solve_the_system(system):
    fast, A, b = system
    δ, iterations = blocks.solve(fast, damping=3.0, tolerance=1e-12, cap=400)
    assert np.allclose(δ.ravel(), np.linalg.solve(A + 3 * np.eye(len(A)), -b.ravel()), rtol=0, atol=1e-10)
    assert 0 < iterations < 400


def test_a_solve_without_damping_is_another_solution(system):
    fast, A, b = system
    δ, _ = blocks.solve(fast, tolerance=1e-12, cap=400)
    assert not np.allclose(δ.ravel(), np.linalg.solve(A + 3 * np.eye(len(A)), -b.ravel()), atol=1e-4)


def test_nothing_to_do_takes_no_iteration(system):
    fast, _, _ = system
    still = blocks.NormalEquations(fast.pattern, fast.blocks, np.zeros_like(fast.gradient))
    δ, iterations = blocks.solve(still)
    assert iterations == 0 and not δ.any()


def test_the_number_of_threads_changes_no_bit(system):
    fast, _, _ = system
    rng = np.random.default_rng(1)
    family = fast.pattern.families[0]
    terms = [(rng.standard_normal((*f.corners.shape, 3)), rng.standard_normal((*f.slot.shape, 3, 3))) for f in fast.pattern.families]
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        one = blocks.assemble(fast.pattern, terms, diagonal=np.zeros(len(family.start) - 1))
    finally:
        numba.set_num_threads(threads)
    many = blocks.assemble(fast.pattern, terms, diagonal=np.zeros(len(family.start) - 1))
    assert np.array_equal(one.blocks, many.blocks) and np.array_equal(one.gradient, many.gradient)
