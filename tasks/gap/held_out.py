"""How far the gap shrinks on motion that nothing was fitted on: windows of held-out recordings, or those of each recording that were kept
out.

E is the mean squared distance of a vertex [mm²] between observation and prediction in a window, what the uncertain start explains taken
out. closed fraction φ = (E_before − E_after)/(E_before − E_floor), E_floor from the observation's noise and the finer re-run. The fall of E
is a ratio of sums over n windows, Σ d_w/Σ m_w of falls d_w of m_w vertices; its interval is Student's (Cochran 1977, §6.4):

    D ± t_{n−1} s,    s² = n/(n − 1) Σ (d_w − D m_w)²/(Σ m_w)²

At the floor there is nothing to close, and millimetres say little: they take errors that neighbours and frames share for as many witnesses.
There the sign of

    ℓ = ½ Σ_w [J_w + log|C_w|]_before/s_w − [J_w + log|C_w|]_after/s_w,    C = R + S_z P S_zᵀ,    s_w = max(1, J_w/n_w) of the nearer of the two

tells whether motion kept out is likelier with a cause than without. A cause that lifts it off its floor speaks against itself, whatever ℓ.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from tasks.cloth.nuisances import Prior, without_state
from tasks.cloth.numerics import FINER, size
from tasks.cloth.shooting import Evidence
from tasks.cloth.windows import Recording

Array = NDArray[np.float64]

DRAWS = 2000
LEVEL = 0.95  # of one end of an interval
LEAST = 0.15  # closed fraction below which nothing was gained that another cause, or none, would not gain too
CLOSABLE = 1.2  # E_before over E_floor below which there is nothing to close, and a fraction of it would mean nothing


@dataclass(frozen=True)
class Shrinkage:
    """√E before, after and floor [mm]; closed fraction (None where the gap is at the floor) with its 90 % interval (None of a single
    window); held out or not; in windows, or in recordings replayed in one run.

    falls: share of bootstrap draws in which the gap falls or, at the floor, ℓ > 0. A cause that acts in one window of five (a touch, a
    turn) is not even drawn in a third of them, and there the fraction of what can be closed means nothing; so the interval is for reading,
    and `shrinks` decides. closable: E over E_floor from which a gap is above its floor.
    """

    before_mm: float
    after_mm: float
    floor_mm: float
    closed_fraction: float | None
    low: float | None
    high: float | None
    held_out: bool
    falls: float = 0.0
    replayed: bool = False
    closable: float = CLOSABLE

    @property
    def at_floor(self) -> bool:
        """Whether there is nothing to close, before or after, though both could be followed."""
        return self.closed_fraction is None and bool(np.isfinite(self.after_mm)) and not self.leaves_floor

    @property
    def leaves_floor(self) -> bool:
        """Whether there was nothing to close before, but is after."""
        return self.closed_fraction is None and self.after_mm**2 > self.closable * self.floor_mm**2

    @property
    def shrinks(self) -> bool:
        """Whether the gap became smaller, or the motion likelier, in most draws and, where there is something to close, by more than `LEAST` of that."""
        gained = not self.leaves_floor if self.closed_fraction is None else self.closed_fraction > LEAST
        return gained and self.falls > 0.5


def unchanged(gap: Shrinkage) -> Shrinkage:
    """The gap where nothing is named: after is as before."""
    nothing = None if gap.closed_fraction is None else 0.0  # for certain
    return replace(gap, after_mm=gap.before_mm, closed_fraction=nothing, low=nothing, high=nothing, falls=0.0)


def floor_mm(evidence: Sequence[Evidence], recordings: Sequence[Recording]) -> float:
    """√E_floor of noise and finer re-run, over the windows of which there is one: that one failed does not say that it would have been the same."""
    noise = 3 * np.mean([np.mean(r.noise**2) for r in recordings])
    finer = [size(e) ** 2 for e in evidence if all(way.name in e.prediction.columns for way in FINER)]
    return float(1e3 * np.sqrt(noise + (np.mean(finer) if finer else 0.0)))


def squared(evidence: Evidence) -> tuple[float, int]:
    """Σ |r|² [mm²] over what was seen in a window, and how many vertices that is."""
    each = 1e6 * np.sum(evidence.residual**2, -1)
    return float(np.nansum(each)), int(np.isfinite(each).sum())


def shrinkage(before: Sequence[Evidence], after: Sequence[Evidence], *, floor_mm: float, held_out: bool, prior: Prior) -> Shrinkage:
    """Compare two models on the same windows; those that one of them could not follow are left out. Where that leaves none, there is no
    after.

    prior: of start states.
    """
    both = [(b, a) for b, a in zip(before, after, strict=True) if b.prediction.complete and a.prediction.complete]
    if not both:
        alone = np.array([squared(b) for b in before if b.prediction.complete])
        gap = float(np.sqrt(alone[:, 0].sum() / alone[:, 1].sum())) if len(alone) else np.nan
        return Shrinkage(gap, np.nan, floor_mm, None, None, None, held_out)
    gap = fallen(np.array([[squared(b)[0], squared(a)[0], squared(b)[1]] for b, a in both]), floor_mm, held_out=held_out)
    if gap.closed_fraction is not None:
        return gap
    ℓ = log_ratios(both, prior)
    return replace(gap, falls=float((ℓ[_draws(len(ℓ))].sum(1) > 0).mean()))


def log_ratios(both: Sequence[tuple[Evidence, Evidence]], prior: Prior) -> Array:
    """ℓ [n] of windows before and after, each by its own misfit."""
    ℓ = []
    for pair in both:
        b, a = (without_state(e.normals, prior) for e in pair)
        s = max(1.0, min(b.c, a.c) / b.n)
        ℓ.append((b.c + b.logdet - a.c - a.logdet) / (2 * s))
    return np.array(ℓ)


def fallen(E: Array, floor_mm: float, *, held_out: bool, replayed: bool = False, closable: float = CLOSABLE) -> Shrinkage:
    """Of Σ |r|² [mm²] before, after and how many vertices that is [n, 3], in n stretches; closable: E_before over E_floor from which there
    is something to close.
    """
    sums = E[_draws(len(E))].sum(1)
    drops = (sums[:, 0] - sums[:, 1]) / sums[:, 2]
    b, a = np.sqrt(E.sum(0)[:2] / E.sum(0)[2])
    falls = float((drops > 0).mean())
    if b**2 <= closable * floor_mm**2:
        return Shrinkage(float(b), float(a), floor_mm, None, None, None, held_out, falls, replayed, closable)
    most = b**2 - floor_mm**2
    low, high = (None if end is None else end / most for end in _interval(E[:, 0] - E[:, 1], E[:, 2]))
    return Shrinkage(float(b), float(a), floor_mm, float((b**2 - a**2) / most), low, high, held_out, falls, replayed, closable)


def _interval(d: Array, m: Array) -> tuple[float | None, float | None]:
    """90 % interval of Σ d/Σ m over stretches [n]; None of a single one."""
    n, D = len(d), d.sum() / m.sum()
    if n < 2:
        return None, None
    s = np.sqrt(n / (n - 1) * np.sum((d - D * m) ** 2)) / m.sum()
    half = stdtrit(n - 1, LEVEL) * s
    return float(D - half), float(D + half)


def _draws(n: int) -> NDArray[np.int64]:
    """Which of n windows each draw holds [DRAWS, n]."""
    return np.random.default_rng(0).integers(0, n, (DRAWS, n))
