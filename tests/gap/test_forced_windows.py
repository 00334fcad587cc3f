"""Least squares within ranges."""

import numpy as np

from tasks.gap.forced_windows import bounded


def test_bounded_is_the_least_of_all_points_in_the_box():
    """Two that are alike: the one that leaves the box first may have to come back once the other is held."""
    A, free = np.array([[1.0, 0.9], [0.9, 1.0]]), np.array([2.0, -0.5])
    np.testing.assert_allclose(bounded(A, A @ free, np.zeros(2), np.ones(2)), [1.0, 0.4], atol=1e-9)
    rng = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 41)] * 3, indexing="ij"), -1).reshape(-1, 3)
    for _ in range(20):
        B = rng.standard_normal((4, 3))
        A, b = B.T @ B + 0.05 * np.eye(3), 2 * rng.standard_normal(3)
        θ = bounded(A, b, np.zeros(3), np.ones(3))
        least, others = (0.5 * np.einsum("...i,ij,...j->...", x, A, x) - x @ b for x in (θ, grid))
        assert (θ >= 0).all() and (θ <= 1).all() and least <= others.min() + 1e-12
