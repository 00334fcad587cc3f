"""Hypotheses about what is missing, fitted and scored in compressed space: no simulation, only the windows' normal equations.

A hypothesis is a set of effects. Its strengths θ and corrections of the base parameters minimise

    Σ_w (r_w − S_w θ)ᵀ C_w⁻¹ (r_w − S_w θ) / s_w  +  prior,     C_w = R + S_z P S_zᵀ + D Dᵀ

within the effects' plausible ranges; s_w is how much the window misfits even with all effects at once. It is judged on windows that its
strengths were not fitted on. With J_w the misfit beyond white noise, the gain of window w is g_w = log(J_w(base)/J_w(H)), and

    L = ½ W log(1 + t²/(W − 1)),     t = √W ḡ / s_g        (0 where ḡ ≤ 0)

is the log likelihood ratio of a mean gain against none when the spread of the gains is unknown. Windows, not coordinates, count as independent:
neighbouring vertices err together, and a cause that is right helps in window after window.

Source: leave-one-out cross-validation (Stone 1974); Student's likelihood ratio (Kendall & Stuart, ch. 22). Limits: linear in θ.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.shooting import PARAMETERS
from tasks.cloth.windows import Normals
from tasks.effects.effect import Effect

Array = NDArray[np.float64]

GAIN_SPREAD, GAIN_WINDOWS = 0.03, 2.0  # spread of gains known beforehand, and the number of windows that knowledge is worth
NOISE_DOUBT = 0.1  # share of the stated noise variance that may be wrong: misfits below that are all alike
NOWHERE: Mapping[str, float] = MappingProxyType({})
BASE_SPREAD = 0.5  # prior standard deviation of a base parameter's logarithm about the refit
RIDGE = 3.0  # prior standard deviation of a strength, in typical strengths


@dataclass(frozen=True)
class Fitted:
    """A hypothesis: effects, steps of the base parameters' logarithms and their covariance, strengths column -> value, their covariance [K, K].

    misfits [W]: of each window beyond noise, fitted on the others; each [W, K]: the strengths found without that window;
    gains [W]: log of the base's misfit over this one's.
    """

    effects: tuple[Effect, ...]
    base: Array
    base_covariance: Array
    strengths: dict[str, float]
    covariance: Array
    misfits: Array
    each: Array
    gains: Array

    @cached_property
    def score(self) -> float:
        """L of the mean gain."""
        return likelihood_ratio(self.gains)

    @property
    def name(self) -> str:
        """Names of the effects, joined; "none" for the base."""
        return " + ".join(e.name for e in self.effects) or "none"

    def θ(self, effect: Effect) -> Array:
        """Strengths [K] of one effect."""
        return np.array([self.strengths[c] for c in effect.columns])


def likelihood_ratio(gains: Array) -> float:
    """L of the mean of gains [W]."""
    t, W = student(gains), len(gains)
    return float(W / 2 * np.log1p(t**2 / max(W - 1, 1))) if t > 0 else 0.0


def student(gains: Array) -> float:
    """t of the mean of gains [W], their spread shrunk towards what is known beforehand."""
    W = len(gains)
    variance = (np.sum((gains - gains.mean()) ** 2) + GAIN_WINDOWS * GAIN_SPREAD**2) / max(W - 1 + GAIN_WINDOWS, 1)
    return float(np.sqrt(W) * gains.mean() / np.sqrt(variance))


class Windows:
    """The windows' normal equations [W], start state and numerics integrated out; linear about the strengths `origin` (column -> value, else 0)."""

    def __init__(self, normals: Sequence[Normals], effects: Sequence[Effect], origin: Mapping[str, float] = NOWHERE) -> None:
        self.normals, self.effects, self.origin = list(normals), list(effects), dict(origin)

    def __len__(self) -> int:
        return len(self.normals)

    @cached_property
    def overdispersion(self) -> Array:
        """s_w [W] ≥ 1: misfit per coordinate with every effect allowed."""
        θ, names = self._solve(self.effects, np.ones(len(self)), np.arange(len(self)))
        return np.array([max(1.0, self._misfit(k, names, θ - self._origin(names)) / n.n) for k, n in enumerate(self.normals)])

    @cached_property
    def noise(self) -> Array:
        """What white noise explains of each misfit [W]: a little less than one per coordinate."""
        θ, names = self._solve(self.effects, 1 / self.overdispersion, np.arange(len(self)))
        known = [self._misfit(k, names, θ - self._origin(names)) for k in range(len(self))]
        return np.array([(1 - NOISE_DOUBT) * min(n.n, misfit) for n, misfit in zip(self.normals, known, strict=True)])

    @cached_property
    def base(self) -> Fitted:
        """Nothing missing."""
        return self._fitted(())

    def fit(self, effects: Sequence[Effect]) -> Fitted:
        """Strengths from all windows, misfits of each from the others."""
        return self._fitted(tuple(effects))

    def about(self, normals: Sequence[Normals], origin: Mapping[str, float]) -> "Windows":
        """The same windows after a new simulation at the strengths `origin`; gains still count from the base of this one."""
        there = Windows(normals, self.effects, origin)
        there.__dict__ |= {"overdispersion": self.overdispersion, "noise": self.noise, "base": self.base}
        return there

    def _fitted(self, effects: tuple[Effect, ...]) -> Fitted:
        everything, p = np.arange(len(self)), len(PARAMETERS)
        w = 1 / self.overdispersion
        θ, names = self._solve(effects, w, everything)
        origin = self._origin(names)
        each = np.array([self._solve(effects, w, everything[everything != k])[0] for k in everything]) if len(self) > 1 else θ[None]
        misfits = np.maximum([self._misfit(k, names, t - origin) - self.noise[k] for k, t in enumerate(each)], 1e-3 * self.noise)
        gains = np.log(self.base.misfits / misfits) if effects else np.zeros(len(self))
        # jackknife (Efron 1982): windows, not coordinates, are independent
        spread = each - each.mean(0)
        covariance = (len(self) - 1) / len(self) * spread.T @ spread
        strengths = dict(zip(names[p:], θ[p:], strict=True))
        return Fitted(effects, θ[:p], covariance[:p, :p], strengths, covariance[p:, p:], misfits, each[:, p:], gains)

    def _origin(self, names: Sequence[str]) -> Array:
        return np.array([self.origin.get(name, 0.0) for name in names])

    def _solve(self, effects: Sequence[Effect], weights: Array, which: Array) -> tuple[Array, list[str]]:
        """θ [P] of base parameters and strengths within their ranges, and the columns' names."""
        columns = [(c, s) for e in effects for c, s in zip(e.columns, e.strengths, strict=True)]
        names = [*PARAMETERS, *(c for c, _ in columns)]
        precision = np.array([BASE_SPREAD**-2] * len(PARAMETERS) + [(RIDGE * s.typical) ** -2 for _, s in columns])
        low = np.array([-np.inf] * len(PARAMETERS) + [s.low for _, s in columns])
        high = np.array([np.inf] * len(PARAMETERS) + [s.high for _, s in columns])
        origin = self._origin(names)
        A, b = np.diag(precision), -precision * origin
        for k in which:
            n = self.normals[k]
            i = n.index(names)
            A += weights[k] * n.G[np.ix_(i, i)]
            b += weights[k] * n.g[i]
        return origin + _bounded(A, b, low - origin, high - origin), names

    def _misfit(self, k: int, names: Sequence[str], θ: Array) -> float:
        """rᵀC⁻¹r of window k after a step θ [P] from the origin."""
        n = self.normals[k]
        i = n.index(names)
        return float(n.c - 2 * n.g[i] @ θ + θ @ n.G[np.ix_(i, i)] @ θ)


def _bounded(A: Array, b: Array, low: Array, high: Array) -> Array:
    """argmin ½ θᵀAθ − bᵀθ with low ≤ θ ≤ high, by fixing what leaves its range until nothing does."""
    θ, held = np.zeros(len(b)), np.zeros(len(b), bool)
    for _ in range(len(b) + 1):
        free = ~held
        θ[free] = np.linalg.solve(A[np.ix_(free, free)], b[free] - A[np.ix_(free, held)] @ θ[held])
        out = free & ((θ < low) | (θ > high))
        if not out.any():
            break
        θ[out] = np.clip(θ[out], low[out], high[out])
        held |= out
    return θ
