"""The same by backward Euler: what a first-order rule, which damps like a Rayleigh damper of one step, would show.

Strength: 1 is backward Euler [1]. Range: 0 or 1 (from ½ on).
Signature: damping in proportion to stiffness, β = h.
Confounders: fabric_membrane_damping and fabric_bending_damping together; it is computed, never fitted.
Source: `simulator.time_integration`; Hairer & Wanner, §V.1. Limits: a rerun, without tangent; nothing where the base is backward Euler.
"""

from collections.abc import Sequence
from dataclasses import replace

from typing_extensions import override

from tasks.effects.effect import Effect, Strength
from tasks.simulator import Settings


class NumericsIntegrator(Effect):
    """Backward Euler."""

    name = "numerics_integrator"
    kind = "rerun"
    strengths = (Strength("on", "1", 1.0, 0.0, 1.0),)
    keeps = frozenset({"rest", "statics", "momentum", "gauge"})

    @override
    def settings(self, settings: Settings, θ: Sequence[float]) -> Settings:
        return replace(settings, integrator="backward_euler") if θ[0] >= 0.5 else settings


EFFECT = NumericsIntegrator()
