"""What a hypothesis gains over a nameless forcing: against the dense likelihood, and on windows that know their cause."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth.windows import Normals
from tasks.gap.acceleration import nameless_acceleration
from tasks.gap.hypotheses import FORCING, Windows
from tasks.gap.strength_priors import BASE_SPREAD, RIDGE
from tests.gap.synthetic import EFFECTS, NAMES, dense

DRAG, DAMPING = EFFECTS[:2]
SIGNATURE = 0.5  # standard deviations of a coordinate per m/s² of forcing


def made(rng, truth, *, σ_a, count=6, n=60, modes=4):
    """Windows [W] of (A, S_a, r): signatures, forcing's columns and residuals, with accelerations ~ N(0, σ_a²) that no effect knows."""
    found = []
    for A, r in dense(rng, lambda k: truth, count=count, n=n):
        S = SIGNATURE * rng.standard_normal((n, modes))
        found.append((A, S, r + S @ (σ_a * rng.standard_normal(modes))))
    return found


def windows(dense_windows):
    normals = []
    for A, S, r in dense_windows:
        B = np.hstack([A, S])
        names = (*NAMES, *(f"a {k} x" for k in range(S.shape[1])))
        normals.append(Normals(names, B.T @ B, B.T @ r, float(r @ r), len(r)))
    return Windows(normals, EFFECTS)


def dense_loss(dense_windows, columns, σ_a, scale):
    """F of the docstring, with every matrix written out."""
    at = [NAMES.index(c) for c in columns]
    typical = {c: s.typical for e in EFFECTS for c, s in zip(e.columns, e.strengths, strict=True)}
    precision = np.diag([(RIDGE * typical[c]) ** -2 if c in typical else BASE_SPREAD**-2 for c in columns])
    H, b, rest = precision.copy(), 0.0, 0.0
    for (A, S, r), s in zip(dense_windows, scale, strict=True):
        C = np.eye(len(r)) + σ_a**2 * S @ S.T
        X = A[:, at]
        H, b = H + X.T @ np.linalg.solve(C, X) / s, b + X.T @ np.linalg.solve(C, r) / s
        rest += r @ np.linalg.solve(C, r) / s + np.linalg.slogdet(C)[1]
    θ = np.linalg.solve(H, b)
    return rest - b @ θ


def test_the_loss_is_the_dense_one_at_its_best_size_of_forcing():
    given = made(np.random.default_rng(0), {"air_normal_drag": 3.0}, σ_a=1.0)
    w = windows(given)
    none = np.nan
    for effects in ((), (DRAG,)):
        columns = NAMES[:2] + [c for e in effects for c in e.columns]
        each = {σ: dense_loss(given, columns, σ, w.scale) for σ in FORCING}
        best = min(each, key=each.get)
        assert w.fit(effects).forcing == best
        if effects:
            assert w.fit(effects).weights[0].decrease == pytest.approx(none - each[best], rel=1e-6)
        none = each[best]


def test_a_cause_with_one_strength_leaves_less_forcing_than_nobody():
    w = windows(made(np.random.default_rng(1), {"air_normal_drag": 12.0}, σ_a=0.0))
    assert w.fit([DRAG]).forcing < w.base.forcing
    assert w.fit([DRAG]).evidence > 5 + max(w.fit([e]).evidence for e in EFFECTS[1:])


def test_what_pushes_anew_in_every_window_is_no_cause_and_stays():
    w = windows(made(np.random.default_rng(2), {}, σ_a=3.0))
    assert max(w.fit([e]).evidence for e in EFFECTS) < 1
    assert min(w.fit([e]).forcing for e in EFFECTS) > 1
    assert w.forcing > 1


def test_the_posterior_of_the_forcing_is_the_dense_one():
    """Mean and deviation of accelerations in two modes and three directions, against the joint Gaussian written out."""
    rng, φ, σ_a = np.random.default_rng(3), np.random.default_rng(4).standard_normal((3, 7)), 1.5
    names = (*NAMES[:2], *(f"a {k} {axis}" for k in range(2) for axis in "xyz"))
    A, S, r = rng.standard_normal((40, 2)), rng.standard_normal((40, 6)), rng.standard_normal(40)
    B = np.hstack([A, S])
    w = Windows([Normals(names, B.T @ B, B.T @ r, float(r @ r), 40)], [])
    h = replace(w.base, base=np.array([0.3, -0.2]), forcing=σ_a)
    mean, deviation = nameless_acceleration(w, h, φ)
    covariance = np.linalg.inv(S.T @ S + np.eye(6) / σ_a**2)
    J = np.kron(φ[:2].T, np.eye(3))  # [7·3, 6] from coefficients to vertices
    np.testing.assert_allclose(mean[0].ravel(), J @ covariance @ S.T @ (r - A @ h.base), rtol=1e-9)
    np.testing.assert_allclose(deviation[0].ravel() ** 2, np.diag(J @ covariance @ J.T), rtol=1e-9)
