"""Implicit rules  y_{n+1} = ŷ + s ẏ_{n+1},  ŷ = a₀ y_n + a₁ y_{n−1}  for y = (x, v), with variable steps.

    backward Euler   s = h,                   a = (1, 0)                                           order 1
    BDF2             s = h (1+ω)/(1+2ω),      a = ((1+ω)²/(1+2ω), −ω²/(1+2ω)),  ω = h/h_previous   order 2

The first step of BDF2 is backward Euler, and so is one of more than `GROWTH` times the last: from 1 + √2 on BDF2 is not zero-stable, and a
step of eight times would carry on 3.8 times over what an impact did to the velocity.

Numerical damping of an undamped oscillator of frequency f, as amplitude kept per period:

    backward Euler   ≈ exp(−2π² f h)          46 % at 1 Hz and h = 40 ms (a 40 ms damper), 82 % at h = 10 ms
    BDF2             ≈ exp(−π (2πfh)³/2)      97.9 % at 1 Hz and h = 40 ms, 99.96 % at h = 10 ms

Both damp everything above 1/h strongly (L-stable).

Source: Hairer & Wanner, Solving ODEs II, §V.1; variable-step coefficients as in Celaya et al. 2014; 1 + √2: Grigorieff 1983.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tasks.simulator.potential import Step

Array = NDArray[np.float64]
Integrator = Literal["bdf2", "backward_euler"]
GROWTH = 2.0 * (1 + 1e-9)  # of a step over the last one: back from halved steps


@dataclass(frozen=True)
class State:
    """Cloth at one time: x, v [V, 3] and the collider [C, 3]."""

    x: Array
    v: Array
    collider: Array


@dataclass(frozen=True)
class Rule:
    """Coefficients of one step: h, s = ∂x/∂v, and the weights of the last two states."""

    h: float
    s: float
    a0: float
    a1: float

    def hat(self, now: Array, before: Array) -> Array:
        """ŷ = a₀ y_n + a₁ y_{n−1}."""
        return self.a0 * now + self.a1 * before if self.a1 else now


def rule(integrator: Integrator, h: float, h_previous: float | None) -> Rule:
    """The rule for a step of h [s] after one of h_previous (None: there was none)."""
    if integrator == "backward_euler" or h_previous is None or h > GROWTH * h_previous:
        return Rule(h, h, 1.0, 0.0)
    ω = h / h_previous
    return Rule(h, h * (1 + ω) / (1 + 2 * ω), (1 + ω) ** 2 / (1 + 2 * ω), -(ω**2) / (1 + 2 * ω))


def known(rule: Rule, now: State, before: State, collider: Array, time: float) -> Step:
    """What the potentials may know of a step that ends at `time` with the collider at [C, 3]."""
    return Step(
        h=rule.h,
        s=rule.s,
        x_n=now.x,
        v_n=now.v,
        x_hat=rule.hat(now.x, before.x),
        v_hat=rule.hat(now.v, before.v),
        collider=collider,
        collider_n=now.collider,
        collider_hat=rule.hat(now.collider, before.collider),
        time=time,
    )
