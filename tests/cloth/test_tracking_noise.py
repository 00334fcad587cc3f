"""Errors that neighbours share: whitening against the dense covariance, and the correlation found in windows that have it."""

import numpy as np
import pytest

from tasks.cloth.likeliest_errors import estimated_correlation
from tasks.cloth.nuisances import Prior
from tasks.cloth.shooting import Job
from tasks.cloth.start_state import States
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.tracking_noise import INDEPENDENT, Correlation, whitened
from tasks.cloth.windows import windows
from tests.cloth.test_windows import FPS, swung


@pytest.mark.parametrize("blind", [True, False])
@pytest.mark.parametrize("correlation", [INDEPENDENT, Correlation(0.6, 0.1), Correlation(0.6, 0.1, 0.08)])
def test_whitening_is_the_dense_covariance(correlation, blind):
    rng = np.random.default_rng(0)
    L, V = 4, 7
    rest, fields = rng.uniform(0, 0.3, (V, 3)), rng.standard_normal((4, L, V, 3))
    seen, σ = rng.uniform(size=(L, V)) < 0.8, rng.uniform(0.5, 2, (L, V))
    seen[2] = seen[1]  # what two frames show alike is foretold better in the second
    seen[0] &= not blind  # a frame may show nothing at all
    white, logdet = whitened(fields, seen, σ, rest, correlation, FPS)
    R = dense(rest, correlation, L)[np.ix_(seen.ravel(), seen.ravel())] * np.outer(σ[seen], σ[seen])
    flat = fields[:, seen]  # [4, seen, 3]
    np.testing.assert_allclose(white.T @ white, np.einsum("anc,bnc->ab", flat, np.linalg.solve(R, flat)), rtol=1e-9)
    assert logdet == pytest.approx(3 * np.linalg.slogdet(R)[1])


def dense(rest, correlation, frames):
    """Correlations [T V, T V] as the module's formula has them."""
    d = np.sqrt(3) * np.linalg.norm(rest[:, None] - rest, axis=-1) / correlation.length
    lag = np.abs(np.subtract.outer(np.arange(frames), np.arange(frames))) / FPS
    lasts = np.exp(-lag / correlation.memory) if correlation.memory else np.eye(frames)
    return np.kron(lasts, correlation.share * (1 + d) * np.exp(-d)) + (1 - correlation.share) * np.eye(frames * len(rest))


@pytest.mark.parametrize("correlation", [INDEPENDENT, Correlation(0.6, 0.1), Correlation(0.6, 0.1, 0.08)])
def test_samples_have_the_correlation(correlation):
    rng, rest = np.random.default_rng(3), np.random.default_rng(0).uniform(0, 0.3, (4, 3))
    ε = np.stack([correlation.sample(rest, np.full((3, 4), 2.0), FPS, rng) for _ in range(4000)]).reshape(4000, 12, 3)
    np.testing.assert_allclose(np.einsum("nic,njc->ij", ε, ε) / 12000 / 4, dense(rest, correlation, 3), atol=0.05)


@pytest.mark.parametrize("true", [INDEPENDENT, Correlation(0.8, 0.12), Correlation(0.8, 0.06, 0.15)])
def test_the_correlation_of_a_twin_is_found(true):
    model, recording, x, v = swung(25)
    noise, rest = 1e-3, model.subject.cloth.x_rest
    observed = x + true.sample(rest, np.full(x.shape[:2], noise), FPS, np.random.default_rng(1))
    seen = recording.__class__(recording.collider, recording.motion, observed, np.full(x.shape[:2], noise))
    φ = smooth_modes(model.subject.cloth, 10)
    todo = [Job(model, seen, w, States(x, v, "converged"), φ) for w in windows([seen], FPS)[::2]]
    assert estimated_correlation(todo, Prior(0.1 * noise, 0.01), noise) == true
