"""Errors that neighbours share: whitening against the dense covariance, and the correlation found in windows that have it."""

import numpy as np
import pytest

from tasks.cloth.shooting import Job, Prior, estimated_correlation
from tasks.cloth.start_state import States
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.tracking_noise import INDEPENDENT, Correlation, whitened
from tasks.cloth.windows import windows
from tests.cloth.test_windows import FPS, swung


@pytest.mark.parametrize("correlation", [INDEPENDENT, Correlation(0.6, 0.1)])
def test_whitening_is_the_dense_covariance(correlation):
    rng = np.random.default_rng(0)
    L, V = 2, 7
    rest, fields = rng.uniform(0, 0.3, (V, 3)), rng.standard_normal((4, L, V, 3))
    seen, σ = rng.uniform(size=(L, V)) < 0.8, rng.uniform(0.5, 2, (L, V))
    white, logdet = whitened(fields, seen, σ, rest, correlation)
    gram, log = np.zeros((4, 4)), 0.0
    for t in range(L):
        on = seen[t]
        R = np.kron(np.outer(σ[t, on], σ[t, on]) * correlation.between(rest[on]), np.eye(3))
        flat = fields[:, t, on].reshape(4, -1)
        gram += flat @ np.linalg.solve(R, flat.T)
        log += np.linalg.slogdet(R)[1]
    np.testing.assert_allclose(white.T @ white, gram, rtol=1e-9)
    assert logdet == pytest.approx(log)


@pytest.mark.parametrize("true", [INDEPENDENT, Correlation(0.8, 0.12)])
def test_the_correlation_of_a_twin_is_found(true):
    model, recording, x, v = swung(25)
    noise, rest = 1e-3, model.subject.cloth.x_rest
    observed = x + true.sample(rest, np.full(x.shape[:2], noise), np.random.default_rng(1))
    seen = recording.__class__(recording.collider, recording.motion, observed, np.full(x.shape[:2], noise))
    φ = smooth_modes(model.subject.cloth, 10)
    todo = [Job(model, seen, w, States(x, v, "converged"), φ) for w in windows([seen], FPS)[::2]]
    assert estimated_correlation(todo, Prior(0.1 * noise, 0.01), noise) == true
