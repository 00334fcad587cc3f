"""κ_b from losses at three stiffnesses, for its derivatives mislead.

Cloth that folds answers to bending with wrinkles which fall anew wherever they are simulated. JᵀJ counts each of them as knowledge, and as
curvature: in soft cloth Gauss–Newton's step in log κ_b was a tenth of the way that the loss fell on, and was called converged; its
intervals held one truth of ten. So after Gauss–Newton the windows are followed at κ_b e^{±h} too. Their losses l_w = n log(χ²_w/n) (scale
unknown, start marginalised) bracket the minimum, and are its normal equations,

    g_w = −½ ∂l_w/∂log κ_b,    H = Σ_w ½ ∂²l_w/∂(log κ_b)²    (of the parabola through three losses)

Where stiffness changes nothing, H is nothing, though JᵀJ is not. κ_s keeps its derivatives: what stretches does not fold. What a finer
computation adds to windows (`numerics.py`) is taken off each, and what it does to all of them alike stands beside what their scatter tells.

Source: profile likelihood (Pawitan 2001, § 3.4). Limits: one parameter; a minimum beyond `FURTHEST` steps is not reached.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.base_parameters import PARAMETERS, moved
from tasks.cloth.base_refit import scaled, unscaled_loss
from tasks.cloth.gauss_newton import Normal
from tasks.cloth.numerics import common_error, corrected
from tasks.cloth.windows import Normals
from tasks.simulator import Fabric

Array = NDArray[np.float64]
Followed = Callable[[Sequence[Fabric]], Sequence[Sequence[Normals] | None]]

ASIDE = float(np.log(1.5))  # h
WORTH = 6.0  # decrease of the loss that is worth a move: where folds fall anew it scatters by ten
FURTHEST = 8  # moves
SAME = 1e-3  # share of κ_b by which fabrics do not differ
LEAST = 1e-3  # of JᵀJ: what counts as no curvature


@dataclass(frozen=True)
class Profile:
    """A fabric, and what each window says below, there and above, columns of numerics kept: [3][W]; h [2]: how far below and above, of log κ_b."""

    fabric: Fabric
    windows: tuple[Sequence[Normals], ...]
    h: Array

    @property
    def losses(self) -> Array:
        """l_w [3, W]."""
        return np.array([[_loss(n) for n in each] for each in self.windows])

    @property
    def normal(self) -> Normal:
        """Normal equations per window; JᵀJ of κ_b shrunk to the curvature met."""
        here = [scaled(corrected(n)) for n in self.windows[1]]
        at = here[0].index(PARAMETERS)
        g, A = np.stack([n.g[at] for n in here]), np.stack([n.G[np.ix_(at, at)] for n in here])
        slopes = np.diff(self.losses, axis=0) / self.h[:, None]  # halfway to either side
        g[:, 1] = -0.5 * (self.h[::-1] @ slopes) / self.h.sum()
        H = float(np.sum(slopes[1] - slopes[0])) / self.h.sum()
        shrunk = np.array([1.0, np.sqrt(np.clip(H / A[:, 1, 1].sum(), LEAST, 1.0))])
        return Normal(g, shrunk[:, None] * A * shrunk, common_error(self.windows[1], PARAMETERS))


def bracketed(fabric: Fabric, follow: Followed) -> Profile | None:
    """The fabric, its κ_b moved by steps of h until the loss rises to either side, and its profile there; None where windows are lost.

    follow: what each window says of each of several fabrics, start state marginalised; None where one cannot be followed.
    """
    known: dict[int, Sequence[Normals] | None] = {}

    def ask(*places: int) -> None:
        """Of all at once: few windows keep few workers busy."""
        new = [k for k in places if k not in known]
        known.update(zip(new, follow([aside(fabric, k) for k in new]), strict=True) if new else ())

    def loss(k: int) -> float:
        each = known[k] if _between_bounds(fabric, k) else None
        return np.inf if each is None else sum(map(_loss, each))

    here = next(k for k in (0, -1, 1) if _between_bounds(fabric, k))
    for _ in range(FURTHEST):
        ask(here - 1, here, here + 1)
        best = min((here - 1, here + 1), key=loss)
        if not loss(best) < loss(here) - WORTH:
            break
        here = best
    points = (here - 1, here, here + 1)
    ask(*points)
    found = tuple(known[k] for k in points)
    h = np.diff([np.log(aside(fabric, k).bending) for k in points])
    return None if any(each is None for each in found) else Profile(aside(fabric, here), found, h)


def aside(fabric: Fabric, steps: float) -> Fabric:
    """The fabric with κ_b e^{steps · h}, within bounds."""
    return moved(fabric, np.array([0.0, steps * ASIDE]))[0]


def _loss(n: Normals) -> float:
    return unscaled_loss(corrected(n))


def _between_bounds(fabric: Fabric, k: int) -> bool:
    """Whether there are fabrics below and above."""
    below, here, above = (aside(fabric, k + side).bending for side in (-1, 0, 1))
    return below < here * (1 - SAME) and above > here * (1 + SAME)
