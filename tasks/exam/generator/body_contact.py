"""Contact of cloth nodes with bodies given as formulas: a logarithmic barrier in the distance, and friction in the velocity.

    P = Σ κ A_i b(d),  b = −(d − d̂)² ln(d/d̂),  d = distance − offset        f_t = −μ λ min(1, |u|/ε)-smoothed u/|u|

u: slip velocity along the surface. λ is the normal force one stage ago. Every node is held off every capsule.
Source: Li et al. 2020 (IPC), with distances that are exact formulas instead of pairs of mesh elements.
"""

from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tasks.exam.generator.bodies import Placed

Array = NDArray[np.float64]
REACH = 1.5e-3  # d̂ [m]
PUSH = 60.0  # acceleration that sets κ = PUSH ρ̄ / d̂ [m/s²]
SLIP = 2e-3  # ε [m/s]
KEPT = 0.1  # share of the gap that one Newton step leaves


@dataclass
class BodyContact:
    """weight [V] kg of cloth at each node; friction μ; offset [m] that the surface stands out. Remembers the last normal forces."""

    weight: Array
    friction: float
    offset: float = 0.0
    normal_force: Array | None = field(default=None)

    def gaps(self, x: Array, body: Placed) -> Array:
        """Distances [K, V] less the offset."""
        return body.distance(x)[0] - self.offset

    def freed(self, x: Array, body: Placed, fixed: NDArray[np.bool_]) -> Array:
        """x with nodes that stand in a body, or nearly, moved out along its normal."""
        x = x.copy()
        for _ in range(20 if len(body.a) else 0):
            d, n = body.distance(x)
            d = d - self.offset
            k, i = d.argmin(0), np.arange(len(x))
            deep = (d[k, i] < 0.2 * REACH) & ~fixed
            if not deep.any():
                break
            x[deep] += ((0.25 * REACH - d[k, i])[:, None] * n[k, i])[deep]
        return x

    def shortened(self, x: Array, step: Array, body: Placed) -> Array:
        """`step` [V, 3], each node's own made so short that it keeps a tenth of its gap."""
        if not len(body.a):
            return step
        least = KEPT * np.minimum(self.gaps(x, body), REACH)
        for _ in range(40):
            into = (self.gaps(x + step, body) < least).any(0) & step.any(1)
            if not into.any():
                break
            step = np.where(into[:, None], 0.6 * step, step)
        return step

    def forces(self, x: Array, v: Array, body: Placed, s: float) -> tuple[Array, Array]:
        """Forces [V, 3] and −∂f/∂x [V, 3, 3], the velocity's part over s included."""
        f, H = np.zeros_like(x), np.zeros((len(x), 3, 3))
        if len(body.a):
            d, n = body.distance(x)
            last = self.normal_force if self.normal_force is not None else np.zeros(d.shape)
            wall = body.va[:, None] + np.cross(body.ω[:, None], x[None] - body.a[:, None])
            _contact(d - self.offset, n, v, wall, last, self.weight, self.friction, s, f, H)
        return f, H

    def remember(self, x: Array, body: Placed) -> None:
        """Keep the normal forces [K, V] at x for the friction of the next stage."""
        d = np.maximum(self.gaps(x, body), 1e-9)
        near = d < REACH
        slope = np.where(near, -2 * (d - REACH) * np.log(d / REACH) - (d - REACH) ** 2 / d, 0.0)
        self.normal_force = -PUSH / REACH * self.weight * slope


@njit(cache=True, nogil=True)
def _contact(d, n, v, wall, last, weight, friction, s, f, H):
    K, V = d.shape
    for k in range(K):
        for i in range(V):
            gap = d[k, i]
            if gap < REACH:
                gap = max(gap, 1e-9)
                κ = PUSH / REACH * weight[i]
                log = np.log(gap / REACH)
                slope = -2 * (gap - REACH) * log - (gap - REACH) ** 2 / gap
                bend = -2 * log - 4 * (gap - REACH) / gap + ((gap - REACH) / gap) ** 2
                for a in range(3):
                    f[i, a] -= κ * slope * n[k, i, a]
                    for b in range(3):
                        H[i, a, b] += κ * bend * n[k, i, a] * n[k, i, b]
            λ = last[k, i]
            if λ > 0 and friction > 0:
                u = v[i] - wall[k, i]
                u = u - (u @ n[k, i]) * n[k, i]
                speed = np.sqrt(u @ u)
                y = speed / SLIP
                factor = (2 - y) / SLIP if y < 1 else 1 / speed
                for a in range(3):
                    f[i, a] -= friction * λ * factor * u[a]
                    for b in range(3):
                        H[i, a, b] += friction * λ * factor / s * ((1.0 if a == b else 0.0) - n[k, i, a] * n[k, i, b])
