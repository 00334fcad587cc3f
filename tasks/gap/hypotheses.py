"""Hypotheses about what is missing, fitted and weighed in compressed space: no simulation, only the windows' normal equations.

A hypothesis is a set of effects. Its strengths θ and corrections of the base parameters minimise

    Σ_w J_w(θ)/s_w + prior,     J_w = (r_w − S_w θ)ᵀ C_w⁻¹ (r_w − S_w θ),     C_w = R + S_z P S_zᵀ + D Dᵀ

within the effects' plausible ranges; s_w is how much the window misfits even with all effects at once. Coordinates of a window err together, so
Δ = Σ_w (J_w(without) − J_w(with))/s_w is no χ². With c_w the score of window w at θ̂ and I the information, both with the base taken out,

    φ = Σ_w (c_w − c̄)ᵀ I⁻¹ (c_w − c̄) / K · W/(W − 1)

says how many times more the scores of windows scatter than independent coordinates would make them: the strength that windows ask for is then
N(θ, φ I⁻¹), and a cause that is right asks for the same in every window. An effect's φ is shrunk towards the median of all effects, worth
`KNOWN` windows; then, with ν = W − 1 + KNOWN,

    L = ν/2 log(1 + Δ/(φ ν)),       evidence = L + log ∫ p(θ) Student_ν(θ − θ̂)/Student_ν(0) dθ

are the log likelihood ratio (Student's) and the log Bayes factor against the hypothesis without the effect. p is log-normal about the typical
strength: a cause of a hundredth of its usual strength is more often the mesh. Effects of a compound are weighed one after the other, each beside those before it.

Source: sandwich covariance (Huber 1967; Liang & Zeger 1986: windows are the clusters); Kass & Raftery 1995. Limits: linear in θ.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import gamma, log, pi
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.shooting import PARAMETERS
from tasks.cloth.windows import Normals
from tasks.effects.effect import Effect

Array = NDArray[np.float64]

KNOWN = 4  # windows that the median dispersion of all effects is worth
FACTOR = 3.0  # of strengths about the typical one: one standard deviation of their logarithm
NOISE_DOUBT = 0.1  # share of the stated noise variance that may be wrong: misfits below that are all alike
NOWHERE: Mapping[str, float] = MappingProxyType({})
BASE_SPREAD = 0.5  # prior standard deviation of a base parameter's logarithm about the refit
RIDGE = 3.0  # prior standard deviation of a strength, in typical strengths


@dataclass(frozen=True)
class Scores:
    """An effect with the base taken out: strengths θ [K], Δ, own φ, I⁻¹ [K, K]."""

    θ: Array
    decrease: float
    dispersion: float
    inverse_information: Array


@dataclass(frozen=True)
class Weight:
    """How one effect weighs beside those before it: Δ, own φ and shrunk φ, L, and what its strength's prior makes of that."""

    decrease: float
    own_dispersion: float
    dispersion: float
    likelihood: float
    prior: float

    @property
    def evidence(self) -> float:
        """Log Bayes factor."""
        return self.likelihood + self.prior


@dataclass(frozen=True)
class Fitted:
    """A hypothesis: effects, steps of the base parameters' logarithms and their covariance, strengths column -> value, their covariance [K, K].

    misfits [W]: of each window beyond noise, fitted on the others; weights: of each effect.
    """

    effects: tuple[Effect, ...]
    base: Array
    base_covariance: Array
    strengths: dict[str, float]
    covariance: Array
    misfits: Array
    weights: tuple[Weight, ...]

    @property
    def likelihood(self) -> float:
        """L against the base."""
        return sum(w.likelihood for w in self.weights)

    @property
    def evidence(self) -> float:
        """Log Bayes factor against the base."""
        return sum(w.evidence for w in self.weights)

    @property
    def name(self) -> str:
        """Names of the effects, joined; "none" for the base."""
        return " + ".join(e.name for e in self.effects) or "none"

    def θ(self, effect: Effect) -> Array:
        """Strengths [K] of one effect."""
        return np.array([self.strengths[c] for c in effect.columns])


def log_averaged(θ: Array, covariance: Array, effect: Effect, ν: float) -> float:
    """log ∫ p(θ') Student_ν(θ' − θ)/Student_ν(0) dθ' for typical strengths of one: what the maximum is worth when the strength is not known.

    Along the ray of θ numerically, across it by Laplace's approximation; p: size u log-normal about the typical one, any direction alike.
    """
    z, Σ = θ / effect.typical, covariance / np.outer(effect.typical, effect.typical)
    K, r = len(z), max(float(np.linalg.norm(z)), 1e-12)
    along = z / r
    σ = np.sqrt(max(float(along @ Σ @ along), 1e-24))
    log_u = np.linspace(-4, 4, 400) * log(FACTOR)
    density = np.exp(-0.5 * (log_u / log(FACTOR)) ** 2) / (np.sqrt(2 * pi) * log(FACTOR)) * (log_u[1] - log_u[0])
    size = float(density @ (1 + ((np.exp(log_u) * np.sqrt(K) - r) / σ) ** 2 / ν) ** (-ν / 2))
    either_way = K == 1 and effect.strengths[0].low < 0
    across = np.sqrt(max(np.linalg.det(Σ), 0.0)) / σ * (np.sqrt(2 * pi) / r) ** (K - 1) if K > 1 else 1.0
    sphere = 2 * pi ** (K / 2) / gamma(K / 2) if K > 1 else 1.0 + either_way
    return log(max(size, 1e-300)) + log(min(max(across, 1e-300) / sphere, 1.0))


class Windows:
    """The windows' normal equations [W], start state and numerics integrated out; linear about the strengths `origin` (column -> value, else 0).

    feigned: column -> standard deviation of the strength that the coarse mesh alone may feign.
    """

    def __init__(
        self,
        normals: Sequence[Normals],
        effects: Sequence[Effect],
        origin: Mapping[str, float] = NOWHERE,
        feigned: Mapping[str, float] = NOWHERE,
    ) -> None:
        self.normals, self.effects, self.origin, self.feigned = list(normals), list(effects), dict(origin), dict(feigned)
        self._medians: dict[tuple[Effect, ...], float] = {}

    def __len__(self) -> int:
        return len(self.normals)

    @cached_property
    def overdispersion(self) -> Array:
        """s_w [W] ≥ 1: misfit per coordinate with every effect allowed."""
        θ, names = self._solve(self.effects, np.ones(len(self)), np.arange(len(self)))
        return np.array([max(1.0, self._misfit(k, names, θ) / n.n) for k, n in enumerate(self.normals)])

    @cached_property
    def noise(self) -> Array:
        """What white noise explains of each misfit [W]: a little less than one per coordinate."""
        θ, names = self._solve(self.effects, 1 / self.overdispersion, np.arange(len(self)))
        known = [self._misfit(k, names, θ) for k in range(len(self))]
        return np.array([(1 - NOISE_DOUBT) * min(n.n, misfit) for n, misfit in zip(self.normals, known, strict=True)])

    @cached_property
    def base(self) -> Fitted:
        """Nothing missing."""
        return self.fit(())

    def fit(self, effects: Sequence[Effect]) -> Fitted:
        """Strengths from all windows, misfits of each from the others; effects are weighed in the order given."""
        effects, everything = tuple(effects), np.arange(len(self))
        w = 1 / self.overdispersion
        θ, names = self._solve(effects, w, everything)
        each = np.array([self._solve(effects, w, everything[everything != k])[0] for k in everything]) if len(self) > 1 else θ[None]
        misfits = np.maximum([self._misfit(k, names, t) - self.noise[k] for k, t in enumerate(each)], 1e-3 * self.noise)
        weights = tuple(self._weigh(e, effects[:k]) for k, e in enumerate(effects))
        φ = max((v.dispersion for v in weights), default=self._dispersion(()))
        covariance = φ * np.linalg.pinv(self._information(names), hermitian=True)
        at, p = names.index, len(PARAMETERS)
        columns = [c for e in effects for c in e.columns]
        k = [at(c) for c in columns]
        strengths = {c: float(θ[at(c)]) for c in columns}
        return Fitted(effects, θ[:p], covariance[:p, :p], strengths, covariance[np.ix_(k, k)], misfits, weights)

    def left(self, effects: Sequence[Effect]) -> float:
        """Misfit per coordinate with these effects."""
        θ, names = self._solve(effects, 1 / self.overdispersion, np.arange(len(self)))
        return sum(self._misfit(k, names, θ) for k in range(len(self))) / sum(n.n for n in self.normals)

    def about(self, normals: Sequence[Normals], effects: Sequence[Effect], origin: Mapping[str, float]) -> "Windows":
        """The same windows after a new simulation with effects at the strengths `origin`, against the base as simulated here.

        By the same scales, but where that simulation misfits less than the linear prediction with every effect at once, by what it misfits.
        """
        there = Windows(normals, self.effects, origin, self.feigned)
        θ, names = there._solve(effects, 1 / self.overdispersion, np.arange(len(self)))
        own = [there._misfit(k, names, θ) / n.n for k, n in enumerate(normals)]
        scale = np.maximum(1.0, np.minimum(self.overdispersion, own))
        there.__dict__ |= {"overdispersion": scale, "noise": self.noise, "base": self.base, "unfitted": self.unfitted}
        there._medians[()] = self._dispersion(())
        return there

    @cached_property
    def unfitted(self) -> Array:
        """J_w [W] of the base with its corrections."""
        θ, names = self._solve((), 1 / self.overdispersion, np.arange(len(self)))
        return np.array([self._misfit(k, names, θ) for k in range(len(self))])

    def _weigh(self, effect: Effect, beside: tuple[Effect, ...]) -> Weight:
        scores = self._scores(effect, beside)
        W, own = len(self), scores.dispersion
        ν = W - 1 + KNOWN
        φ = max(1.0, ((W - 1) * own + KNOWN * self._dispersion(beside)) / ν)
        σ2 = φ * scores.inverse_information + np.diag([self.feigned.get(c, 0.0) ** 2 for c in effect.columns])
        surprise = min(scores.decrease / φ, float(scores.θ @ np.linalg.pinv(σ2, hermitian=True) @ scores.θ))
        likelihood = 0.5 * ν * np.log1p(max(surprise, 0.0) / ν)
        prior = log_averaged(scores.θ, σ2, effect, ν)
        return Weight(scores.decrease, own, φ, float(likelihood), prior)

    def _scores(self, effect: Effect, beside: tuple[Effect, ...]) -> "Scores":
        """An effect beside others, the base and they taken out."""
        w, everything = 1 / self.overdispersion, np.arange(len(self))
        θ, names = self._solve((*beside, effect), w, everything)
        decrease = float(w @ (self._without(beside) - [self._misfit(k, names, θ) for k in everything]))
        K = len(effect.strengths)
        p = len(names) - K
        step, index = θ - self._origin(names), [n.index(names) for n in self.normals]
        each = [(w[k] * n.G[np.ix_(i, i)], w[k] * n.g[i]) for k, (n, i) in enumerate(zip(self.normals, index, strict=True))]
        A = sum(G for G, _ in each)
        a = A[p:, :p] @ np.linalg.pinv(A[:p, :p], hermitian=True)
        c = np.array([g - G @ step for G, g in each]) @ np.hstack([-a, np.eye(K)]).T
        I = A[p:, p:] - a @ A[:p, p:]
        inverse = np.linalg.pinv(I, rcond=1e-9, hermitian=True)
        spread = c - c.mean(0)
        φ = float(np.einsum("wi,ij,wj->", spread, inverse, spread)) / K * len(self) / max(len(self) - 1, 1)
        return Scores(θ[p:], decrease, φ, inverse)

    def _without(self, beside: tuple[Effect, ...]) -> Array:
        """J_w [W] with only these effects."""
        if not beside:
            return self.unfitted
        θ, names = self._solve(beside, 1 / self.overdispersion, np.arange(len(self)))
        return np.array([self._misfit(k, names, θ) for k in range(len(self))])

    def _dispersion(self, beside: tuple[Effect, ...]) -> float:
        """Median φ of all effects beside some."""
        if beside not in self._medians:
            own = {e.name for e in beside}
            φ = [self._scores(e, beside).dispersion for e in self.effects if e.name not in own]
            self._medians[beside] = float(np.median([x for x in φ if x > 0] or [1.0]))
        return self._medians[beside]

    def _information(self, names: Sequence[str]) -> Array:
        """Σ_w G_w/s_w [P, P] of some columns."""
        index = [n.index(names) for n in self.normals]
        return sum(n.G[np.ix_(i, i)] / s for n, i, s in zip(self.normals, index, self.overdispersion, strict=True))

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
        """rᵀC⁻¹r of window k at θ [P]."""
        n = self.normals[k]
        i, step = n.index(names), θ - self._origin(names)
        return float(n.c - 2 * n.g[i] @ step + step @ n.G[np.ix_(i, i)] @ step)


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
