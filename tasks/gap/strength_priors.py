"""Priors of strengths and base parameters, and what a fitted strength is worth once it is not known.

A cause of a hundredth of its usual strength is more often the mesh: sizes are log-normal about the typical one. In fits the same is said by
a ridge, so that what no window touches stays as uncertain as it was.
"""

from collections.abc import Sequence
from math import gamma, log, pi

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.base_parameters import PARAMETERS
from tasks.effects.effect import Effect

Array = NDArray[np.float64]

FACTOR = 3.0  # of strengths about the typical one: one standard deviation of their logarithm
BASE_SPREAD = 0.5  # prior standard deviation of a base parameter's logarithm about the refit
RIDGE = 3.0  # prior standard deviation of a strength, in typical strengths


def precision(effects: Sequence[Effect]) -> Array:
    """Of the priors of base parameters and strengths [P]."""
    return np.array([BASE_SPREAD**-2] * len(PARAMETERS) + [(RIDGE * s.typical) ** -2 for e in effects for s in e.strengths])


def log_averaged(θ: Array, covariance: Array, effect: Effect, ν: float, *, asked: Array | None = None, shows: float = 0.0) -> float:
    """log ∫ p(θ') Student_ν(θ' − θ*)/Student_ν(θ − θ*) dθ' for typical strengths of one: what the maximum θ within the range is worth when the
    strength is not known. asked: θ*, which windows ask for whatever the range, where that is less (default: θ).

    Along the ray of θ numerically, and of a single component of either sign along the other one too, on points of the prior and of the
    peak, which may be far narrower; across it by Laplace's approximation.
    p: size u log-normal about the typical one, any direction alike. shows: size below which a cause does not show; nothing is claimed of
    such ones.
    """
    z, Σ = θ / effect.typical, covariance / np.outer(effect.typical, effect.typical)
    K, r = len(z), float(np.linalg.norm(z))
    along = z / r if r > 1e-9 else np.full(K, K**-0.5)  # at the end of its range: any direction
    σ = np.sqrt(max(float(along @ Σ @ along), 1e-24))
    short = 0.0 if asked is None else min(float(along @ ((asked - θ) / effect.typical)) / σ, 0.0)  # along the ray, in deviations
    peak = (r + σ * np.linspace(-12, 12, 241)) / np.sqrt(K)
    u = np.unique(np.concatenate([np.exp(np.linspace(-8, 4, 600) * log(FACTOR)), peak[peak > 0]]))
    density = np.exp(-0.5 * (np.log(u) / log(FACTOR)) ** 2) / (np.sqrt(2 * pi) * log(FACTOR) * u) * (u >= shows)
    either_way = K == 1 and effect.strengths[0].low < 0
    rays = (1, -1) if either_way else (1,)
    falls = [((1 + ((sign * u * np.sqrt(K) - r) / σ - short) ** 2 / ν) / (1 + short**2 / ν)) ** (-ν / 2) for sign in rays]
    size = sum(float(np.trapezoid(density * each, u)) for each in falls)
    across = np.sqrt(max(np.linalg.det(Σ), 0.0)) / σ * (np.sqrt(2 * pi) / max(r, 1e-9)) ** (K - 1) if K > 1 else 1.0
    sphere = 2 * pi ** (K / 2) / gamma(K / 2) if K > 1 else 1.0 + either_way
    return log(max(size, 1e-300)) + log(min(max(across, 1e-300) / sphere, 1.0))
