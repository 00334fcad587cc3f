"""Friction against the body other than the base model's μ = 0.2 (`simulator.contact_friction`).

Strength: Δμ [1]. Range: dry fabric on skin or jersey μ 0.2–0.6, wet above 1; typical Δμ = 0.3. Where more is taken away than there is,
μ = 0; the tangent is then the one towards more friction.
Signature: tangential, where cloth touches the body, from the moment it slips.
Confounders: boundary_slip, body_offset (more pressure), damping near contact; the direction of sliding tells.
Source: Chen et al. 2013; Rasheed et al. 2020. Limits: one coefficient, static and kinetic alike; friction among cloth stays the base's.
"""

from collections.abc import Sequence
from dataclasses import replace

from typing_extensions import override

from tasks.effects.effect import Effect, Strength
from tasks.simulator import Fabric


class BodyFriction(Effect):
    """More friction against the body."""

    name = "contact_friction"
    kind = "potential"
    strengths = (Strength("Δμ", "1", 0.3, -0.2, 1.0),)
    keeps = frozenset({"rest", "gauge"})
    confused_with = frozenset({"boundary_slip", "body_offset", "contact_thickness"})

    @property
    @override
    def parameters(self) -> dict[str, tuple[str, ...]]:
        return {self.name: ("friction_collider",)}

    @override
    def fabric(self, fabric: Fabric, θ: Sequence[float]) -> Fabric:
        among = fabric.friction if fabric.self_friction is None else fabric.self_friction
        return replace(fabric, friction=max(0.0, fabric.friction + θ[0]), self_friction=among)


EFFECT = BodyFriction()
