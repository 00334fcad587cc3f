"""Is the strength a constant? Found again in every window, at every speed and in every zone.

A right name has one strength everywhere; a wrong one drifts (linear drag fitted to quadratic falls as 1/v). Each named effect enters as one
column, its signature at the strengths found; m is the multiple of it that a part of the recording asks for, base parameters and the
other named effects fitted along. Cochran's Q = Σ (m_k − m̄)²/σ_k² is χ² with K − 1 degrees of freedom when m is constant.

σ_k of a window comes from its normal equations and its own scale s_w; of speeds and zones from the jackknife over windows. Zones use the
fields themselves, unwhitened, what the start state explains taken out. Limits: linear in the strength.

A model that errs a little everywhere has Q far above its degrees of freedom for every name: compare `scatter` between names, not p with
5 %.

Source: Cochran 1954 (Q); Efron 1982 (jackknife).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.numerics import finer
from tasks.cloth.shooting import Evidence
from tasks.cloth.windows import Normals
from tasks.gap.hypotheses import Fitted, Windows
from tasks.gap.strength_priors import BASE_SPREAD

Array = NDArray[np.float64]

SPEEDS = ("slow", "middle", "fast")
FEWEST = 3  # windows of a group that has a spread of its own


@dataclass(frozen=True)
class Constancy:
    """places [K], multiples m [K] of the strength found and their standard deviations [K]; Q, its degrees of freedom and p (NaN for K < 2)."""

    places: tuple[str, ...]
    multiples: Array
    deviations: Array
    Q: float
    freedom: int
    p: float

    @property
    def scatter(self) -> float:
        """√(Q/(K − 1)): about 1 for a constant."""
        return float(np.sqrt(self.Q / self.freedom)) if self.freedom else float("nan")


def cochran(m: Array, σ: Array) -> tuple[float, int, float]:
    """Q, degrees of freedom, p of multiples m [K] ± σ [K]."""
    if len(m) < 2:
        return float("nan"), 0, float("nan")
    w = 1 / σ**2
    Q = float(np.sum(w * (m - np.sum(w * m) / w.sum()) ** 2))
    return Q, len(m) - 1, float(chi2.sf(Q, len(m) - 1))


def by_window(windows: Windows, named: Fitted) -> dict[str, Constancy]:
    """effect -> its multiple in every window."""
    each = _directed(windows, named)
    places = [str(k + 1) for k in range(len(each))]
    return _told(named, places, [_multiples([n]) for n in each], [_deviations([n]) for n in each])


def by_speed(windows: Windows, named: Fitted, speed: Array) -> dict[str, Constancy]:
    """effect -> its multiple in the slow, middle and fast third of the windows; speed [W] m/s."""
    each, order = _directed(windows, named), np.argsort(speed)
    groups = {name: [each[k] for k in part] for name, part in zip(SPEEDS, np.array_split(order, 3), strict=True)}
    return _grouped(named, groups)


def by_zone(evidence: Sequence[Evidence], named: Fitted, zone: NDArray[np.str_]) -> dict[str, Constancy]:
    """effect -> its multiple in every zone [V] but the driven one."""
    names = [z for z in dict.fromkeys(zone.tolist()) if z != "pinned"]
    done = [e for e in evidence if e.prediction.complete]
    return _grouped(named, {str(z): [_fields(e, named, zone == z) for e in done] for z in names})


def speeds(evidence: Sequence[Evidence], fps: float) -> Array:
    """Root mean square speed [W] m/s of the cloth in every complete window."""
    done = [e.prediction.x for e in evidence if e.prediction.complete]
    return np.array([fps * np.sqrt(np.mean(np.sum(np.diff(x, axis=0) ** 2, -1))) for x in done])


def _grouped(named: Fitted, groups: Mapping[str, Sequence[Normals]]) -> dict[str, Constancy]:
    kept = {name: own for name, own in groups.items() if len(own) >= FEWEST}
    return _told(named, list(kept), [_multiples(own) for own in kept.values()], [_jackknife(own) for own in kept.values()])


def _told(named: Fitted, places: Sequence[str], m: Sequence[Array], σ: Sequence[Array]) -> dict[str, Constancy]:
    found = {}
    for k, effect in enumerate(named.effects):
        own, spread = np.array([a[k] for a in m]), np.array([a[k] for a in σ])
        known = np.isfinite(own) & np.isfinite(spread) & (spread > 0)
        own, spread = own[known], spread[known]
        found[effect.name] = Constancy(tuple(np.array(places)[known]), own, spread, *cochran(own, spread))
    return found


def directions(named: Fitted) -> dict[str, dict[str, float]]:
    """effect -> column -> strength: the direction that a multiple of 1 stands for; the typical one where nothing was found."""
    found = {}
    for e in named.effects:
        θ = named.θ(e) if named.θ(e).any() else e.typical
        found[e.name] = dict(zip(e.columns, map(float, θ), strict=True))
    return found


def _directed(windows: Windows, named: Fitted) -> list[Normals]:
    """Per window: base parameters, and one column per named effect."""
    found, along = [], directions(named)
    for n, s in zip(windows.normals, windows.scale, strict=True):
        T = np.zeros((len(n.names), len(PARAMETERS) + len(along)))
        T[n.index(PARAMETERS), range(len(PARAMETERS))] = 1
        for k, θ in enumerate(along.values(), len(PARAMETERS)):
            T[n.index(list(θ)), k] = list(θ.values())
        found.append(Normals((*PARAMETERS, *along), T.T @ n.G @ T / s, T.T @ n.g / s, n.c / s, n.n))
    return found


def _fields(e: Evidence, named: Fitted, inside: NDArray[np.bool_]) -> Normals:
    """The same of one zone, from fields; per square millimetre, which cancels."""
    columns = e.prediction.columns
    r = e.residual - finer(columns)
    on = np.isfinite(r).all(-1) & inside
    along = directions(named)
    A = [columns[p][on] for p in PARAMETERS] + [sum(x * columns[c] for c, x in θ.items())[on] for θ in along.values()]
    A, r = 1e3 * np.stack([a.ravel() for a in A], 1), 1e3 * r[on].ravel()
    return Normals((*PARAMETERS, *along), A.T @ A, A.T @ r, float(r @ r), len(r))


def _information(own: Sequence[Normals]) -> Array:
    p = len(PARAMETERS)
    G = sum(n.G for n in own)
    return G + np.diag([BASE_SPREAD**-2] * p + [0.0] * (len(G) - p))


def _multiples(own: Sequence[Normals]) -> Array:
    θ = np.linalg.lstsq(_information(own), sum(n.g for n in own), rcond=1e-12)[0]
    return θ[len(PARAMETERS) :]


def _deviations(own: Sequence[Normals]) -> Array:
    return np.sqrt(np.maximum(np.diag(np.linalg.pinv(_information(own), rcond=1e-12)), 0))[len(PARAMETERS) :]


def _jackknife(own: Sequence[Normals]) -> Array:
    each = np.array([_multiples([n for j, n in enumerate(own) if j != k]) for k in range(len(own))])
    return np.sqrt((len(own) - 1) * each.var(0))
