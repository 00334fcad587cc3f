"""Hypotheses about what is missing, fitted and weighed in compressed space: no simulation, only the windows' normal equations.

A hypothesis is a set of effects. Its strengths θ, corrections of the base parameters, and the size σ_a of the forcing that it leaves
nameless minimise

    F = Σ_w J_w(θ)/s_w + log|C_w| + prior,     J_w = (r_w − S_w θ)ᵀ C_w⁻¹ (r_w − S_w θ),     C_w = R + S_z P S_zᵀ + D Dᵀ + σ_a² S_a S_aᵀ

within the effects' plausible ranges. A window that misfits m_w ≥ 1 times per coordinate even with all effects at once, at whatever
strengths it asks for itself, holds something that none explains: folds that fell otherwise, some `LEFT` independent numbers and not n_w. A
remainder of m_w − 1 of the noise's variance in so few numbers makes the score of a smooth cause vary n_w/`LEFT` times as much as white
noise of its size would, so

    s_w = 1 + (m_w − 1) n_w/LEFT,     W = (Σ_w 1/s_w)²/Σ_w 1/s_w²

and a window that kinks has next to no say beside one that is explained (generalised least squares, with windows as clusters); W is how many
windows that leaves in effect (Kish 1965). Forcing explains anything, but anew in every window (`cloth/forcing.py`): a hypothesis gains by
what it explains with one strength. What folds and contacts do in windows is still no white noise, so Δ = F(without) − F(with) is no χ².
With c_w the score of window w at θ̂ and I the information, both with the base taken out,

    φ = Σ_w (c_w − c̄)ᵀ I⁻¹ (c_w − c̄) / K · W/(W − 1)

says how many times more the scores of windows scatter than independent coordinates would make them: the strength that windows ask for is
then N(θ, φ I⁻¹), and a cause that is right asks for the same in every window. An effect's φ is shrunk towards the median of all effects,
worth `KNOWN` windows; then, with ν = W − 1 + KNOWN,

    L = ν/2 log(1 + Δ/(φ ν)),       evidence = L + log ∫ p(θ) Student_ν(θ − θ̂)/Student_ν(0) dθ

are the log likelihood ratio (Student's) and the log Bayes factor against the hypothesis without the effect. p is log-normal about the
typical strength: a cause of a hundredth of its usual strength is more often the mesh. Effects of a compound are weighed one after the
other, each beside those before it.

Source: sandwich covariance (Huber 1967; Liang & Zeger 1986: windows are the clusters); Kass & Raftery 1995; Kish 1965, § 11.7. Limits: linear in θ.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.nuisances import without_forcing
from tasks.cloth.windows import Normals
from tasks.effects.effect import Effect
from tasks.gap.forced_windows import Forced, in_effect
from tasks.gap.strength_priors import log_averaged, precision

Array = NDArray[np.float64]

KNOWN = 4  # windows that the median dispersion of all effects is worth
NOISE_DOUBT = 0.1  # share of the stated noise variance that may be wrong: misfits below that are all alike
NOWHERE: Mapping[str, float] = MappingProxyType({})
FORCING = (0.0, *(float(a) for a in np.geomspace(0.03, 10.0, 11)))  # candidates for σ_a [m/s²]
FORM = 0.1  # relative standard deviation of a strength between implementations of its law: drag of faces or of vertices, angle or tangent of a hinge
LEFT = 50  # independent numbers that what a window leaves beyond noise is worth


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
    """A hypothesis: effects, steps of the base parameters' logarithms and their covariance, strengths column -> value, their covariance [K,
    K].

    misfits [W]: of each window beyond noise, fitted on the others; weights: of each effect; forcing: σ_a [m/s²] that is left; freedom: ν.
    support: log Bayes factor against the base by replays of whole recordings, once it was simulated (`replay.py`).
    """

    effects: tuple[Effect, ...]
    base: Array
    base_covariance: Array
    strengths: dict[str, float]
    covariance: Array
    misfits: Array
    weights: tuple[Weight, ...]
    forcing: float = 0.0
    freedom: float = KNOWN
    support: float | None = None

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

    def quantile(self, level: float) -> float:
        """Of Student's t: how many standard deviations off a strength or base parameter may be."""
        return float(stdtrit(self.freedom, level))

    def θ(self, effect: Effect) -> Array:
        """Strengths [K] of one effect."""
        return np.array([self.strengths[c] for c in effect.columns])


class Windows:
    """The windows' normal equations [W], start state and numerics integrated out, forcing not; linear about the strengths `origin` (column
    -> value, else 0).

    feigned: column -> standard deviation of the strength that the coarse mesh alone may feign.
    """

    def __init__(
        self,
        normals: Sequence[Normals],
        effects: Sequence[Effect],
        origin: Mapping[str, float] = NOWHERE,
        feigned: Mapping[str, float] = NOWHERE,
    ) -> None:
        self.given, self.effects, self.origin, self.feigned = list(normals), list(effects), dict(origin), dict(feigned)
        self._losses: dict[tuple[Effect, ...], tuple[float, float]] = {}
        self._medians: dict[tuple[Effect, ...], float] = {}
        self._sizes: dict[float, list[Normals]] = {}

    def __len__(self) -> int:
        return len(self.given)

    @cached_property
    def forcing(self) -> float:
        """σ_a [m/s²] that is left when every effect is allowed."""
        ones = np.ones(len(self))
        return min(FORCING, key=lambda σ: Forced(self._at(σ), ones, self.origin).loss(self.effects))

    @cached_property
    def normals(self) -> list[Normals]:
        """With that forcing marginalised."""
        return self._at(self.forcing)

    @cached_property
    def overdispersion(self) -> Array:
        """m_w [W] ≥ 1: misfit per coordinate with every effect allowed, in each window for itself."""
        return np.maximum(1.0, self._each_alone(self.effects))

    @cached_property
    def scale(self) -> Array:
        """s_w [W] ≥ 1."""
        return self._scaled_for(self.overdispersion)

    @property
    def freedom(self) -> float:
        """ν, degrees of freedom of a dispersion estimated from these windows and the median of all effects."""
        return in_effect(self.scale) - 1 + KNOWN

    @cached_property
    def noise(self) -> Array:
        """What white noise explains of each misfit [W]: a little less than one per coordinate."""
        forced = Forced(self.normals, self.scale, self.origin)
        return (1 - NOISE_DOUBT) * np.minimum(self._coordinates, forced.misfits(*forced.solve(self.effects)))

    @cached_property
    def base(self) -> Fitted:
        """Nothing missing."""
        return self.fit(())

    def fit(self, effects: Sequence[Effect]) -> Fitted:
        """Strengths from all windows, misfits of each from the others; effects are weighed in the order given."""
        effects = tuple(effects)
        _, σ_a = self._loss(effects)
        forced = self._forced(σ_a)
        θ, names = forced.solve(effects)
        allowed = self._forced(self.forcing)
        each = [allowed.solve(effects, k)[0] for k in range(len(self))] if len(self) > 1 else [θ]
        misfits = np.array([allowed.misfits(t, names)[k] for k, t in enumerate(each)])
        weights = tuple(self._weigh(e, effects[:k]) for k, e in enumerate(effects))
        φ = max((v.dispersion for v in weights), default=self._dispersion(()))
        unseen = np.diag(precision(effects))  # what no window touches is as uncertain as it was, not known
        covariance = np.linalg.inv(sum(G for G, _ in forced.scaled(names)) / φ + unseen)
        p = len(PARAMETERS)
        strengths = dict(zip(names[p:], map(float, θ[p:]), strict=True))
        misfits = np.maximum(misfits - self.noise, 1e-3 * self.noise)
        doubt = np.array([np.hypot(self.feigned.get(c, 0.0), FORM * value) for c, value in strengths.items()])
        own = covariance[p:, p:] + np.diag(doubt**2)
        return Fitted(effects, θ[:p], covariance[:p, :p], strengths, own, misfits, weights, σ_a, self.freedom)

    def beside(self, normals: Sequence[Normals]) -> "Windows":
        """These windows and further ones, linear about the same."""
        return Windows([*self.given, *normals], self.effects, self.origin, self.feigned)

    def only(self, kept: Sequence[int]) -> "Windows":
        """Some of these windows, linear about the same."""
        return self if len(kept) == len(self) else Windows([self.given[k] for k in kept], self.effects, self.origin, self.feigned)

    def about(
        self, normals: Sequence[Normals], effects: Sequence[Effect], origin: Mapping[str, float], first: "Windows | None" = None
    ) -> "Windows":
        """The same windows after a new simulation with effects at the strengths `origin`, against the base as simulated here, and of two
        effects against the first alone as simulated in `first`.

        All by the same scales: of the linear prediction with every effect at once and that simulation, what misfits a window less.
        """
        there = Windows(normals, self.effects, origin, self.feigned)
        here = Windows(self.given, self.effects, self.origin, self.feigned)
        least = np.maximum(1.0, np.minimum(self.overdispersion, there._each_alone(effects)))
        here.__dict__["scale"] = self._scaled_for(least)
        there.__dict__ |= {"scale": here.scale, "noise": self.noise, "base": here.base}
        there._losses[()] = here._loss(())
        there._medians[()] = here._dispersion(())
        if first is not None:
            one = Windows(first.given, self.effects, first.origin, self.feigned)
            one.__dict__["scale"], alone = here.scale, tuple(effects[:1])
            there._losses[alone], there._medians[alone] = one._loss(alone), one._dispersion(alone)
        return there

    @property
    def _coordinates(self) -> Array:
        """n_w [W]."""
        return np.array([n.n for n in self.given])

    def _scaled_for(self, misfit: Array) -> Array:
        """s_w [W] of windows that misfit so many times per coordinate [W]."""
        return 1 + (misfit - 1) * self._coordinates / LEFT

    def _each_alone(self, effects: Sequence[Effect]) -> Array:
        """Misfit per coordinate [W] with these effects, at the strengths that each window asks for itself."""
        alone = (Forced([n], np.ones(1), self.origin) for n in self.normals)
        return np.array([forced.misfits(*forced.solve(effects))[0] for forced in alone]) / self._coordinates

    def _at(self, σ_a: float) -> list[Normals]:
        """With a forcing of size σ_a [m/s²] marginalised."""
        if σ_a not in self._sizes:
            self._sizes[σ_a] = [without_forcing(n, σ_a) for n in self.given]
        return self._sizes[σ_a]

    def _forced(self, σ_a: float) -> Forced:
        return Forced(self._at(σ_a), self.scale, self.origin)

    def _loss(self, effects: tuple[Effect, ...]) -> tuple[float, float]:
        """Least F of a hypothesis, and the σ_a [m/s²] that it has there."""
        if effects not in self._losses:
            self._losses[effects] = min((self._forced(σ).loss(effects), σ) for σ in FORCING)
        return self._losses[effects]

    def _weigh(self, effect: Effect, beside: tuple[Effect, ...]) -> Weight:
        loss, σ_a = self._loss((*beside, effect))
        decrease = self._loss(beside)[0] - loss
        scores = self._forced(σ_a).scores(effect, beside)
        ν, own = self.freedom, scores.dispersion
        φ = max(1.0, ((ν - KNOWN) * own + KNOWN * self._dispersion(beside)) / ν)
        feigned = np.array([self.feigned.get(c, 0.0) for c in effect.columns])
        σ2 = φ * scores.inverse_information + np.diag(feigned**2)
        shows = float(np.sqrt(np.mean((feigned / effect.typical) ** 2)))
        surprise = min(decrease / φ, float(scores.θ @ np.linalg.pinv(σ2, hermitian=True) @ scores.θ))
        likelihood = 0.5 * ν * np.log1p(max(surprise, 0.0) / ν)
        return Weight(decrease, own, φ, float(likelihood), log_averaged(scores.θ, σ2, effect, ν, asked=scores.asked, shows=shows))

    def _dispersion(self, beside: tuple[Effect, ...]) -> float:
        """Median φ of all effects beside some."""
        if beside not in self._medians:
            own = {e.name for e in beside}
            forced = self._forced(self._loss(beside)[1])
            φ = [forced.scores(e, beside).dispersion for e in self.effects if e.name not in own]
            self._medians[beside] = float(np.median([x for x in φ if x > 0] or [1.0]))
        return self._medians[beside]
