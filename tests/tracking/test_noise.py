"""The sampled posterior against the dense inverse."""

import numpy as np
import pytest

from tasks.tracking import blocks, noise


def chain(n=30):
    """Springs between neighbours, the first vertex held: a system whose uncertainty grows along the chain."""
    corners = np.column_stack([np.arange(n - 1), np.arange(1, n)])
    H = np.tile(1e6 * np.array([[1, -1], [-1, 1]])[None, :, :, None, None] * np.eye(3), (n - 1, 1, 1, 1, 1))
    diagonal = np.zeros(n)
    diagonal[0] = 1e6
    return blocks.assemble(blocks.pattern(n, corners), [(np.zeros((n - 1, 2, 3)), H)], diagonal=diagonal)


def test_samples_find_the_diagonal_of_the_inverse():
    system = chain()
    exact = np.sqrt(np.diag(np.linalg.inv(blocks.dense(system) + np.eye(90) / 0.1**2)).reshape(30, 3).mean(1))
    assert exact[-1] > 4 * exact[0]
    assert noise.posterior(system, samples=2000) == pytest.approx(exact, rel=4 / np.sqrt(6 * 2000))
    assert noise.posterior(system) == pytest.approx(exact, rel=4 / np.sqrt(6 * 32))


def test_the_same_system_gives_the_same_noise():
    assert np.array_equal(noise.posterior(chain()), noise.posterior(chain()))


def test_block_diagonal_alone_would_promise_too_much():
    """Neighbours that are uncertain themselves support one another less than their own blocks say."""
    system = chain()
    naive = np.sqrt(1 / system.blocks[system.pattern.diagonal][:, 0, 0])
    assert noise.posterior(system)[-1] > 3 * naive[-1]
