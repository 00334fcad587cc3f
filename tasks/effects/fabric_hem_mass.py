"""Heavier hems: further mass along every open border that is not pinned.

    m_v = λ Σ ½ |ē| over the border edges at v with a free end,   P = Σ m_v (½ |x − x̃|²/s² − g·x)

Strength: λ/ρ̄ [m], the width of cloth that weighs as much. Range: λ 3–10 g/m (a turned hem of two more layers, 1–3 cm), to 20 g/m with
trimmings, at ρ̄ 0.08–0.35 kg/m².
Signature: the lower edge lags and pulls straight; slower swings, smaller waves at the hem.
Confounders: fabric_density_gradient (measured |cos| 0.72), air_added_mass (no weight), fabric_seam_stiffness where it stands for the hem.
Source: mass of the layers. Limits: all free borders alike; no stiffness of the hem; the standard gravity, without a tilt.
"""

from collections.abc import Sequence

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.effects.further_mass import FurtherMass
from tasks.geometry.meshes import boundary_edges, edge_lengths
from tasks.simulator import Cloth
from tasks.simulator.potential import Array, Potential


class FabricHemMass(Effect):
    """Further mass along free borders."""

    name = "fabric_hem_mass"
    kind = "potential"
    strengths = (Strength("λ/ρ̄", "m", 0.04, 0.0, 0.25),)
    keeps = frozenset({"gauge"})
    confused_with = frozenset({"fabric_density_gradient", "air_added_mass"})

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (FurtherMass(self.name, subject.fabric.areal_density * _border(subject.cloth), θ[0]),)


def _border(cloth: Cloth) -> Array:
    """Length [V] m of free border that belongs to each vertex."""
    edges = boundary_edges(cloth.faces)
    edges = edges[~np.isin(edges, cloth.boundary).all(1)]
    length = edge_lengths(cloth.x_rest, edges)
    return np.bincount(edges.ravel(), np.repeat(length / 2, 2), len(cloth.x_rest))


EFFECT = FabricHemMass()
