"""Which effects this recording can show at all, and which of them it can tell apart: the geometry of their signatures.

A signature S_e is the derivative of the prediction, whitened by each window's covariance (noise, start state, numerics) and its own scale
s_w, the base parameters taken out. Its length at typical strength is a number of standard deviations; below `SHOWN` the recording cannot
test it. The cosine of two signatures is 1 where they are the same up to strength; −1 where one undoes the other. For effects of several
components it is the largest canonical correlation, the cosine of the most alike directions.

Source: Hotelling 1936 (canonical correlations); detectability as in optimal experiment design.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.base_refit import summed
from tasks.cloth.windows import Normals, marginalised
from tasks.effects.effect import Effect
from tasks.gap.hypotheses import Windows
from tasks.gap.strength_priors import BASE_SPREAD

Array = NDArray[np.float64]

SHOWN = 3.0  # standard deviations


@dataclass(frozen=True)
class Confusability:
    """names [E], cosine [E, E], that of the least alike directions [E, E] (0 where one effect has more components than the other),
    detectability [E] in standard deviations at typical strength.
    """

    names: tuple[str, ...]
    cosine: Array
    least: Array
    detectability: Array

    @property
    def testable(self) -> NDArray[np.bool_]:
        """Whether the recording could show each effect at typical strength."""
        return self.detectability >= SHOWN


def confusability(windows: Windows, effects: Sequence[Effect]) -> Confusability:
    """Of these effects, in their order."""
    columns = [c for e in effects for c in e.columns]
    n = signatures(windows, columns)
    blocks = [n.index(e.columns) for e in effects]
    white = [_inverse_root(n.G[np.ix_(i, i)]) for i in blocks]
    canonical = [[a @ n.G[np.ix_(i, j)] @ b for j, b in zip(blocks, white, strict=True)] for i, a in zip(blocks, white, strict=True)]
    cosine, least = (np.array([[measure(C) for C in row] for row in canonical]) for measure in (_cosine, _least_cosine))
    detectability = [np.sqrt(max(e.typical @ n.G[np.ix_(i, i)] @ e.typical, 0.0)) for e, i in zip(effects, blocks, strict=True)]
    return Confusability(tuple(e.name for e in effects), cosine, least, np.array(detectability))


def over_scales(windows: Windows) -> list[Normals]:
    """Normal equations of every window [W], over its own scale s_w."""
    return [Normals(n.names, n.G / s, n.g / s, n.c / s, n.n) for n, s in zip(windows.normals, windows.scale, strict=True)]


def signatures(windows: Windows, columns: Sequence[str]) -> Normals:
    """Normal equations of these columns over all windows, each by its own scale, the base parameters integrated out."""
    names, scaled = [*PARAMETERS, *columns], over_scales(windows)
    G, g = summed(scaled, names)
    whole = Normals(tuple(names), G, g, sum(n.c for n in scaled), sum(n.n for n in scaled))
    return marginalised(whole, PARAMETERS, np.full(len(PARAMETERS), BASE_SPREAD**2))


def _inverse_root(G: Array) -> Array:
    """G^(−1/2) on its range."""
    λ, U = np.linalg.eigh(G)
    return U @ np.diag(np.where(λ > 1e-9 * max(λ.max(), 1e-30), 1 / np.sqrt(np.maximum(λ, 1e-30)), 0.0)) @ U.T


def _cosine(C: Array) -> float:
    return float(C[0, 0]) if C.size == 1 else float(np.linalg.norm(C, 2))


def _least_cosine(C: Array) -> float:
    if C.shape[0] != C.shape[1]:
        return 0.0
    return _cosine(C) if C.size == 1 else float(np.linalg.norm(C, -2))
