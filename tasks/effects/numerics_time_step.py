"""The same in smaller steps: how far the time step is from not mattering.

Strength: log₂ of the number of steps in place of each [1]; 1 is half the step. Range: 0–3; rounded to whole steps.
Signature: damping-like; grows with frequency.
Confounders: everything that damps; it is computed and taken off before any of them is named, never fitted.
Source: Richardson's comparison of two steps. Limits: a rerun, without tangent.
"""

from collections.abc import Sequence
from dataclasses import replace

from typing_extensions import override

from tasks.effects.effect import Effect, Strength
from tasks.simulator import Settings


class NumericsTimeStep(Effect):
    """Smaller steps."""

    name = "numerics_time_step"
    kind = "rerun"
    strengths = (Strength("log₂n", "1", 1.0, 0.0, 3.0),)
    keeps = frozenset({"rest", "statics", "momentum", "gauge"})

    @override
    def settings(self, settings: Settings, θ: Sequence[float]) -> Settings:
        return replace(settings, substeps=round(settings.substeps * 2 ** θ[0]))


EFFECT = NumericsTimeStep()
