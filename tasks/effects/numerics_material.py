"""The same of another material form: neo-Hookean where the base model is Saint Venant–Kirchhoff, and the other way round.

Both have the same constants and differ from the second order of the strain on. Nobody knows which a fabric is.

Strength: 1 is the other form [1]. Range: 0 or 1 (from ½ on).
Signature: where cloth is stretched or sheared by per cents.
Confounders: fabric_stiffening, fabric_orthotropy; it is computed, never fitted.
Source: `simulator.settings`; Li et al. 2021 (C-IPC) for the neo-Hookean one. Limits: a rerun, without tangent.
"""

from collections.abc import Sequence
from dataclasses import replace

from typing_extensions import override

from tasks.effects.effect import Effect, Strength
from tasks.simulator import Settings


class NumericsMaterial(Effect):
    """The other form."""

    name = "numerics_material"
    kind = "rerun"
    strengths = (Strength("on", "1", 1.0, 0.0, 1.0),)
    keeps = frozenset({"momentum", "gauge"})

    @override
    def settings(self, settings: Settings, θ: Sequence[float]) -> Settings:
        other = "neo_hookean" if settings.membrane == "stvk" else "stvk"
        return replace(settings, membrane=other) if θ[0] >= 0.5 else settings


EFFECT = NumericsMaterial()
