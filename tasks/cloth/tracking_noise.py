"""Errors of a tracker: a part of its own for every vertex, and a part that neighbours share.

    cov(ε_i, ε_j) = σ_i σ_j ((1 − ρ) δ_ij + ρ K(|X_i − X_j|)),    K(d) = (1 + √3 d/ℓ) exp(−√3 d/ℓ)

per frame and coordinate, X at rest. Taken for white, errors shared by neighbours look like wrinkles that the cloth never had, and a thousand
vertices that err together like a thousand witnesses. ρ and ℓ are those of highest marginal likelihood among `CANDIDATES` (`shooting.py`).

Source: nugget and Matérn 3/2, as in geostatistics (Stein 1999). Limits: errors of different frames count as independent.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.spatial.distance import cdist

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Correlation:
    """share ρ of the variance that neighbours within about `length` ℓ [m] have in common."""

    share: float
    length: float

    def between(self, rest: Array) -> Array:
        """Correlations [V, V] of vertices that are at `rest` [V, 3] m."""
        d = np.sqrt(3) * cdist(rest, rest) / self.length
        return self.share * (1 + d) * np.exp(-d) + (1 - self.share) * np.eye(len(rest))

    def sample(self, rest: Array, σ: Array, rng: np.random.Generator) -> Array:
        """Errors [T, V, 3] m of standard deviations σ [T, V] m."""
        white = rng.standard_normal((*σ.shape, 3))
        return σ[..., None] * (np.linalg.cholesky(self.between(rest)) @ white if self.share else white)


INDEPENDENT = Correlation(0.0, 1.0)
CANDIDATES = (INDEPENDENT, *(Correlation(ρ, ℓ) for ρ, ℓ in product((0.25, 0.5, 0.8), (0.03, 0.06, 0.12))))


def whitened(fields: Array, seen: NDArray[np.bool_], σ: Array, rest: Array, correlation: Correlation) -> tuple[Array, float]:
    """R^(−1/2) of fields [K, L, V, 3] m at the vertices seen [L, V], σ [L, V] m, as [N, K]; and log|R|."""
    parts, logdet, roots = [], 0.0, {}
    for field, on, s in zip(fields.transpose(1, 2, 3, 0), seen, σ, strict=True):  # [V, 3, K] of each frame
        scaled = field[on] / s[on, None, None]
        logdet += 6 * float(np.log(s[on]).sum())
        if correlation.share:
            key = on.tobytes()
            if key not in roots:
                roots[key] = np.linalg.cholesky(correlation.between(rest[on]))
            logdet += 6 * float(np.log(np.diag(roots[key])).sum())
            scaled = solve_triangular(roots[key], scaled.reshape(len(scaled), -1), lower=True).reshape(scaled.shape)
        parts.append(scaled.reshape(-1, fields.shape[0]))
    return np.concatenate(parts), logdet
