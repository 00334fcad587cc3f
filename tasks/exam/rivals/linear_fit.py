"""Effects beside the base parameters, fitted by least squares to a linear model of what was recorded, every strength within its range.

    minimise  θᵀAθ − 2bᵀθ,      low ≤ θ ≤ high,      gain = 2bᵀθ − θᵀAθ: by how much the sum of squares falls

A = Σ SᵀR⁻¹S, b = Σ SᵀR⁻¹r over the columns S of `PARAMETERS` and of all effects, r the residual of the model they are linear about.

Source: Stark & Parker 1995 (bounded-variable least squares), on the factor of A = QΛQᵀ.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from tasks.cloth.base_parameters import PARAMETERS, moved, with_fabric
from tasks.cloth.base_refit import LARGEST_STEP
from tasks.effects.effect import Effect
from tasks.effects.model import Model

Array = NDArray[np.float64]

SMALLEST = 1e-10  # eigenvalue, over the largest, of a direction that still shows


@dataclass(frozen=True)
class Fit:
    """Effects, steps of the base parameters' logarithms [2], strengths and their standard deviations name -> [K], and the gain."""

    effects: tuple[Effect, ...]
    base: Array
    strengths: dict[str, Array]
    deviation: dict[str, Array]
    gain: float

    @property
    def names(self) -> tuple[str, ...]:
        """Of the effects."""
        return tuple(e.name for e in self.effects)

    @property
    def by_column(self) -> dict[str, float]:
        """column -> strength."""
        return {c: float(θ) for e in self.effects for c, θ in zip(e.columns, self.strengths[e.name], strict=True)}


def column_names(effects: Sequence[Effect]) -> list[str]:
    """Base parameters, then every column of every effect."""
    return [*PARAMETERS, *(c for e in effects for c in e.columns)]


def typical(effects: Sequence[Effect]) -> Array:
    """Size [P] of each column's coefficient: 1 of a logarithm, the typical strength of an effect."""
    return np.array([1.0] * len(PARAMETERS) + [abs(s.typical) for e in effects for s in e.strengths])


def by_effect(θ: Array, effects: Sequence[Effect]) -> dict[str, Array]:
    """name -> its coefficients among θ [P]."""
    ends = np.cumsum([len(PARAMETERS), *(len(e.strengths) for e in effects)])
    return {e.name: θ[a:z] for e, a, z in zip(effects, ends, ends[1:], strict=False)}


def fit(A: Array, b: Array, among: Sequence[Effect], effects: Sequence[Effect]) -> Fit:
    """Fit some effects; A [P, P] and b [P] are of `column_names(among)`."""
    names, scale = column_names(among), typical(effects)
    i = [names.index(name) for name in column_names(effects)]
    A, b = A[np.ix_(i, i)] * np.outer(scale, scale), b[i] * scale
    low, high = np.array([(-LARGEST_STEP, LARGEST_STEP)] * len(PARAMETERS) + [(s.low, s.high) for e in effects for s in e.strengths]).T
    u = _ranged(A, b, low / scale, high / scale)
    sd = scale * np.sqrt(np.maximum(np.diag(np.linalg.pinv(A, hermitian=True)), 0))
    θ = scale * u
    return Fit(tuple(effects), θ[: len(PARAMETERS)], by_effect(θ, effects), by_effect(sd, effects), float(2 * b @ u - u @ A @ u))


def applied(model: Model, effects: Sequence[Effect], base: Array, strengths: Mapping[str, Array]) -> Model:
    """The model after a step [2] of the base parameters' logarithms, with effects at strengths name -> [K]."""
    fabric = moved(model.subject.fabric, base)[0]
    return replace(with_fabric(model, fabric), effects=tuple(effects), strengths=strengths)


def _ranged(A: Array, b: Array, low: Array, high: Array) -> Array:
    """argmin uᵀAu − 2bᵀu; directions on which nothing depends stay at zero."""
    λ, Q = np.linalg.eigh(A)
    shows = λ > SMALLEST * max(λ[-1], 1e-300)
    if not shows.any():
        return np.zeros(len(b))
    root = np.sqrt(λ[shows])
    return lsq_linear((root * Q[:, shows]).T, (Q[:, shows].T @ b) / root, (low, high), method="bvls").x
