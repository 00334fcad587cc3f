"""Areal density that changes from the bottom of the garment to its top.

    ρ̄(η) = ρ̄ (1 + g η),   η = (height − mean height)/(greatest − least height),   P = Σ ρ̄ A_v g η (½ |x − x̃|²/s² − g·x)

Height: v of the pattern where there is one, else y of the rest mesh. The mean over the area is zero, so that the garment's mass stays.
Strength: g [-], positive: heavier at the top. Range: ±1 (prints, linings, a fabric of two weights).
Signature: tension, swing and stretch shift along the height; the natural frequency of a hanging panel changes.
Confounders: fabric_hem_mass (measured |cos| 0.72), stiffness that changes with height, air_added_mass.
Source: mass of the layers. Limits: linear; |g| < 1.5, beyond which the mass of a triangular cut would be negative; pattern pieces must
share one v axis; the standard gravity, without a tilt.
"""

from collections.abc import Sequence

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.effects.further_mass import FurtherMass
from tasks.simulator import Cloth
from tasks.simulator.potential import Array, Potential


class FabricDensityGradient(Effect):
    """Density that changes with height."""

    name = "fabric_density_gradient"
    kind = "potential"
    strengths = (Strength("g", "1", -0.3, -1.0, 1.0),)
    keeps = frozenset({"gauge"})
    confused_with = frozenset({"fabric_hem_mass", "air_added_mass"})

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        cloth = subject.cloth
        return (FurtherMass(self.name, subject.fabric.areal_density * cloth.vertex_areas * _height(cloth), θ[0]),)


def _height(cloth: Cloth) -> Array:
    """η [V]; zero for cloth without height."""
    if cloth.uv is None:
        height = cloth.x_rest[:, 1]
    else:
        corners = np.bincount(cloth.faces.ravel(), minlength=len(cloth.x_rest))
        height = np.bincount(cloth.faces.ravel(), cloth.uv[:, :, 1].ravel(), len(corners)) / np.maximum(corners, 1)
    span = np.ptp(height)
    return (height - np.average(height, weights=cloth.vertex_areas)) / span if span else np.zeros_like(height)


EFFECT = FabricDensityGradient()
