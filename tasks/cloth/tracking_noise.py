"""Errors of a tracker: a part of its own for every vertex and frame, and a part that neighbours share and that wanders from frame to frame.

    cov(ε_it, ε_js) = σ_it σ_js ((1 − ρ) δ_ij δ_ts + ρ K(|X_i − X_j|) e^(−|t − s|/τ)),    K(d) = (1 + √3 d/ℓ) exp(−√3 d/ℓ)

per coordinate, X at rest. Taken for white, errors shared by neighbours look like wrinkles that the cloth never had, those that last like
forces that push it, and a thousand vertices that err together like a thousand witnesses. ρ, ℓ and τ are those of highest marginal
likelihood (`likeliest_errors.py`).

The shared part is an autoregression, so that its Kalman filter whitens: what is left of a frame once those before have foretold its errors
is independent of them, however many vertices were not seen.

Source: nugget and Matérn 3/2, as in geostatistics (Stein 1999); innovations (Kailath 1968). Limits: one τ for all places.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.spatial.distance import cdist

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Correlation:
    """share ρ of the variance that neighbours within about `length` ℓ [m] have in common, and that a `memory` τ [s] later is e times less."""

    share: float
    length: float
    memory: float = 0.0

    def shared(self, rest: Array) -> Array:
        """What errors of one frame have in common [V, V], of their variance, of vertices that are at `rest` [V, 3] m."""
        return self.between(cdist(rest, rest))

    def between(self, apart: Array) -> Array:
        """ρK of vertices that are `apart` [...] m at rest."""
        d = np.sqrt(3) * apart / self.length
        return self.share * (1 + d) * np.exp(-d)

    def kept(self, fps: float) -> float:
        """What a frame remembers of the shared part of the one before."""
        return float(np.exp(-1 / (fps * self.memory))) if self.memory else 0.0

    def sample(self, rest: Array, σ: Array, fps: float, rng: np.random.Generator) -> Array:
        """Errors [T, V, 3] m of standard deviations σ [T, V] m."""
        own, new = rng.standard_normal((2, *σ.shape, 3))
        k = self.kept(fps)
        root = np.linalg.cholesky(self.shared(rest) + 1e-9 * np.eye(len(rest)))
        slow = root @ new
        for t in range(1, len(slow)):
            slow[t] = k * slow[t - 1] + np.sqrt(1 - k**2) * slow[t]
        return σ[..., None] * (slow + np.sqrt(1 - self.share) * own)

    def lasting(self) -> "tuple[Correlation, ...]":
        """The same with each of `MEMORIES`."""
        return tuple(replace(self, memory=τ) for τ in MEMORIES)


INDEPENDENT = Correlation(0.0, 1.0)
IN_ONE_FRAME = (INDEPENDENT, *(Correlation(ρ, ℓ) for ρ, ℓ in product((0.25, 0.5, 0.8), (0.03, 0.06, 0.12))))  # candidates
MEMORIES = (0.0, 0.05, 0.15, 0.5)  # candidates [s]


def whitened(fields: Array, seen: NDArray[np.bool_], σ: Array, rest: Array, correlation: Correlation, fps: float) -> tuple[Array, float]:
    """R^(−1/2) of fields [K, L, V, 3] m at the vertices seen [L, V], σ [L, V] m, as [N, K]; and log|R|."""
    K, frames = len(fields), fields.transpose(1, 2, 3, 0)
    scaled = [(field[on] / s[on, None, None]).reshape(on.sum(), 3 * K) for field, on, s in zip(frames, seen, σ, strict=True)]
    logdet = 6 * float(np.log(σ[seen]).sum())
    if not correlation.share:
        return np.concatenate(scaled).reshape(-1, K), logdet
    parts, roots = [], {}
    now = shared = correlation.shared(rest)  # covariance of the shared part as the frames before foretell it
    foretold, k = np.zeros((len(rest), 3 * K)), correlation.kept(fps)
    for field, on in zip(scaled, seen, strict=True):
        key = on.tobytes()
        if k or key not in roots:
            roots[key] = np.linalg.cholesky(now[np.ix_(on, on)] + (1 - correlation.share) * np.eye(on.sum()))
        root = roots[key]
        logdet += 6 * float(np.log(np.diag(root)).sum())
        left = solve_triangular(root, field - foretold[on], lower=True)
        parts.append(left.reshape(-1, K))
        if k and len(parts) < len(scaled):  # the last foretells nothing
            gain = solve_triangular(root, now[on], lower=True)
            foretold, now = k * (foretold + gain.T @ left), k**2 * (now - gain.T @ gain) + (1 - k**2) * shared
    return np.concatenate(parts), logdet
