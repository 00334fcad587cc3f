"""Windows with a forcing of one size marginalised: strengths within their ranges by least squares, and how windows agree on them.

Formulas and sources: `hypotheses.py`, whose F, scores and s_w these are.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear

from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.windows import Normals
from tasks.effects.effect import Effect
from tasks.gap.strength_priors import RIDGE, precision

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scores:
    """An effect with the base taken out: strengths θ [K] within their ranges, those asked for whatever the range [K], own φ, I⁻¹ [K, K]."""

    θ: Array
    asked: Array
    dispersion: float
    inverse_information: Array


class Forced:
    """The windows' normal equations [W] with a forcing of one size marginalised, each over its scale s_w.

    A hypothesis without an effect of `origin` has none of it, and not as much as was simulated.
    """

    def __init__(self, normals: Sequence[Normals], scale: Array, origin: Mapping[str, float]) -> None:
        self.normals, self.scale, self.origin = list(normals), scale, origin

    def solve(self, effects: Sequence[Effect], left_out: int | None = None) -> tuple[Array, list[str]]:
        """θ [P] of base parameters and strengths within their ranges, and the columns' names; `left_out`: a window that has no say."""
        columns = [(c, s) for e in effects for c, s in zip(e.columns, e.strengths, strict=True)]
        names = [*PARAMETERS, *(c for c, _ in columns)]
        low = np.array([-np.inf] * len(PARAMETERS) + [s.low for _, s in columns])
        high = np.array([np.inf] * len(PARAMETERS) + [s.high for _, s in columns])
        origin, tight = self.origin_of(names), precision(effects)
        A, b = np.diag(tight), -tight * origin
        for k, (G, g) in enumerate(self.scaled(names)):
            if k != left_out:
                A, b = A + G, b + g
        return origin + bounded(A, b, low - origin, high - origin), names

    def scaled(self, names: Sequence[str]) -> list[tuple[Array, Array]]:
        """G/s_w [P, P] and g/s_w [P] of some columns of every window."""
        index = [n.index(names) for n in self.normals]
        return [(n.G[np.ix_(i, i)] / s, n.g[i] / s) for n, i, s in zip(self._without_others(names), index, self.scale, strict=True)]

    def misfits(self, θ: Array, names: Sequence[str]) -> Array:
        """J_w [W] at θ [P]."""
        step, found = θ - self.origin_of(names), []
        for n in self._without_others(names):
            i = n.index(names)
            found.append(n.c - 2 * n.g[i] @ step + step @ n.G[np.ix_(i, i)] @ step)
        return np.array(found)

    def losses(self, θ: Array, names: Sequence[str]) -> Array:
        """J_w/s_w + log|C_w| [W] at θ [P]."""
        return self.misfits(θ, names) / self.scale + np.array([n.logdet for n in self.normals])

    def loss(self, effects: Sequence[Effect]) -> float:
        """F at its least."""
        θ, names = self.solve(effects)
        return float(np.sum(self.losses(θ, names)) + precision(effects) @ θ**2)

    def _without_others(self, names: Sequence[str]) -> list[Normals]:
        """About `origin` without the effects that are not among `names`."""
        back = {c: -θ for c, θ in self.origin.items() if c not in names}
        return [n.stepped(np.array([back.get(name, 0.0) for name in n.names])) for n in self.normals] if back else self.normals

    def origin_of(self, names: Sequence[str]) -> Array:
        """What the columns are linear about [P]."""
        return np.array([self.origin.get(name, 0.0) for name in names])

    def scores(self, effect: Effect, beside: Sequence[Effect]) -> Scores:
        """An effect beside others, the base and they taken out."""
        θ, names = self.solve((*beside, effect))
        K = len(effect.strengths)
        p, each = len(names) - K, self.scaled(names)
        step, A = θ - self.origin_of(names), sum(G for G, _ in each)
        a = A[p:, :p] @ np.linalg.pinv(A[:p, :p], hermitian=True)
        c = np.array([g - G @ step for G, g in each]) @ np.hstack([-a, np.eye(K)]).T
        unseen = np.diag(1 / (RIDGE * effect.typical) ** 2)  # a component that moves nothing is as uncertain as it was
        inverse = np.linalg.inv(A[p:, p:] - a @ A[:p, p:] + unseen)
        spread, W = c - c.mean(0), in_effect(self.scale)
        φ = float(np.einsum("wi,ij,wj->", spread, inverse, spread)) / K * W / max(W - 1, 1)
        return Scores(θ[p:], θ[p:] + inverse @ c.sum(0), φ, inverse)


def in_effect(scale: Array) -> float:
    """How many windows there are where each says so much less [W]."""
    return float(np.sum(1 / scale) ** 2 / np.sum(1 / scale**2))


def bounded(A: Array, b: Array, low: Array, high: Array) -> Array:
    """argmin ½ θᵀAθ − bᵀθ with low ≤ θ ≤ high, A positive definite (Stark & Parker 1995, on the factor A = LLᵀ of unit diagonal)."""
    θ = np.linalg.solve(A, b)
    if np.all((low <= θ) & (θ <= high)):
        return θ
    scale = 1 / np.sqrt(np.diag(A))
    L = np.linalg.cholesky(A * np.outer(scale, scale))
    return scale * lsq_linear(L.T, solve_triangular(L, scale * b, lower=True), (low / scale, high / scale), method="bvls").x
