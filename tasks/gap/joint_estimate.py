"""Fabric and strengths from windows and from whole recordings together.

    θ = argmin  ½ (θ − θ_w)ᵀ C_w⁻¹ (θ − θ_w) + n E(θ)/(2 E₁)

θ_w, C_w: what windows say, priors in it; E(θ): quadratic about replays that are E₁ off (`replay.py`), which so are worth n = 2/s² independent numbers, as
many as make log E scatter by the s that is assumed there. What acts fast shows in windows; a tilt, a wind or a pattern of another
size hides there behind start states and forcing, and adds up over a whole recording. Far from the recording E₁ is large, and windows have
the say.

Derivatives over seconds of cloth may lead anywhere, or nowhere: large ones that have nothing to do with what is left hold a strength
wherever it was simulated. So estimates are replayed, and compare by what they then are

    Q(θ) = ½ (θ − θ_w)ᵀ C_w⁻¹ (θ − θ_w) + n/2 log E(θ)

of which the above is the first step from E₁.

Source: Tarantola 2005, § 3.2 (a Gaussian prior and linear data).
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.windows import Normals
from tasks.gap.forced_windows import bounded
from tasks.gap.hypotheses import FORM, NOWHERE, Fitted
from tasks.gap.replay import Replayed, supported

Array = NDArray[np.float64]

LEAST = 0.25  # of the floor, below which no replay is foretold to come


def joint(windows: Fitted, told: Normals, off: Replayed, origin: Mapping[str, float] = NOWHERE) -> Fitted:
    """The hypothesis that windows and replays together ask for. told: E(θ) [m²] about the strengths `origin` and the fabric of replays that
    are so far `off`.
    """
    columns, p = list(windows.strengths), len(PARAMETERS)
    i = told.index([*PARAMETERS, *columns])
    at = np.array([0.0] * p + [origin.get(c, 0.0) for c in columns])
    θ_w = np.concatenate([windows.base, list(windows.strengths.values())])
    seen = block_diag(*_precisions(windows))
    worth = degrees(off) / off.gap
    G, g = told.G[np.ix_(i, i)] * worth, told.g[i] * worth
    A, b = seen + G, seen @ θ_w + g + G @ at
    strengths = [s for e in windows.effects for s in e.strengths]
    low, high = (np.array([end] * p + [getattr(s, key) for s in strengths]) for end, key in ((-np.inf, "low"), (np.inf, "high")))
    θ, C = bounded(A, b, low, high), np.linalg.pinv(A, hermitian=True)
    return replace(
        windows,
        base=θ[:p],
        base_covariance=C[:p, :p],
        strengths=dict(zip(columns, map(float, θ[p:]), strict=True)),
        covariance=C[p:, p:] + _of_form(θ[p:]),
    )


def _precisions(windows: Fitted) -> tuple[Array, Array]:
    """C_w⁻¹ of base parameters [2, 2] and strengths [K, K]."""
    own = windows.covariance - _of_form(np.array(list(windows.strengths.values())))
    return np.linalg.pinv(windows.base_covariance, hermitian=True), np.linalg.pinv(own, hermitian=True)


def _of_form(θ: Array) -> Array:
    """Covariance [K, K] of strengths between implementations of a law: windows and replays err alike by it, so that it is no disagreement,
    and stays.
    """
    return np.diag((FORM * θ) ** 2)


def degrees(off: Replayed) -> float:
    """n of replays: how many independent numbers they are worth."""
    return 2 / off.spread**2


def disagreement(asked: Fitted, windows: Fitted, off: Replayed) -> float:
    """Q of an estimate with which replays end so far `off`."""
    δ, η = asked.base - windows.base, np.array([asked.strengths[c] - θ for c, θ in windows.strengths.items()])
    apart = sum(d @ A @ d for d, A in zip((δ, η), _precisions(windows), strict=True))
    return float(0.5 * apart + 0.5 * degrees(off) * np.log(off.gap))


def foretold(windows: Fitted, told: Normals, off: Replayed, origin: Mapping[str, float] = NOWHERE) -> tuple[Fitted, float]:
    """The joint hypothesis about replays that are `off` and hold the strengths `origin`, and its log Bayes factor against them as far as
    derivatives tell.
    """
    h = joint(windows, told, off, origin)
    i = told.index([*PARAMETERS, *h.strengths])
    δ = np.concatenate([h.base, [θ - origin.get(c, 0.0) for c, θ in h.strengths.items()]])
    G = told.G[np.ix_(i, i)]
    E = told.c - 2 * told.g[i] @ δ + δ @ G @ δ
    return h, supported(off, replace(off, gap=max(E, LEAST * off.floor), apart=float(δ @ G @ δ)))
