"""The same with stiffer contact: how much it matters that the barrier gives.

Cloth lies somewhere within the barrier distance, the nearer the harder it is pressed; real skin, and other simulators, give otherwise.

Strength: log₂ of the barrier's strength per areal density, in place of the model's [1]; 2 is four times. Range: 0–4.
Signature: cloth pressed on by its own inertia, before and behind a limb that swings.
Confounders: air_added_mass, contact_thickness, body_lag; it is computed, never fitted.
Source: `simulator.settings` (contact_acceleration); Li et al. 2020 for the barrier. Limits: a rerun, without tangent; nothing without a
collider.
"""

from collections.abc import Sequence
from dataclasses import replace

from typing_extensions import override

from tasks.effects.effect import Effect, Strength
from tasks.simulator import Settings


class NumericsContact(Effect):
    """A stronger barrier."""

    name = "numerics_contact"
    kind = "rerun"
    strengths = (Strength("log₂c", "1", 2.0, 0.0, 4.0),)
    keeps = frozenset({"rest", "gauge"})

    @override
    def settings(self, settings: Settings, θ: Sequence[float]) -> Settings:
        return replace(settings, contact_acceleration=settings.contact_acceleration * 2.0 ** θ[0])


EFFECT = NumericsContact()
