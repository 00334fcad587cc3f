"""Air drag across the cloth in proportion to its speed.

    D = Σ_faces ½ c A (v·n)²  [W],   force −c A (v·n) n

v: mean velocity of the corners; n, A: normal and area of the face at the start of the step (lagged).
Strength: c/ρ̄ [1/s]. Range: c 0.01–0.3 N·s/m³ at ρ̄ 0.08–0.35 kg/m²: slow motion, porous cloth, air pressed through or out of folds.
Signature: as air_normal_drag, but linear: twice the swing gives twice the force, where the quadratic law gives four times.
Confounders: air_normal_drag (two speeds), fabric_mass_damping (edge-on motion; the same for face-on motion of uniform cloth, α = c/ρ̄).
Source: Mao et al., whose recordings of real cloth a linear drag with lift fits better than quadratic laws; Darcy's law for porous cloth.
Limits: still air; the permeability of the cloth does not change with its stretch.
"""

from collections.abc import Sequence

from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.effects.faces_in_air import SquareAcross
from tasks.simulator.potential import Potential


class AirLinearDrag(Effect):
    """Linear drag across the cloth."""

    name = "air_linear_drag"
    kind = "potential"
    strengths = (Strength("c/ρ̄", "1/s", 0.7, 0.0, 4.0),)
    keeps = frozenset({"rest", "statics", "energy", "gauge"})
    confused_with = frozenset({"air_normal_drag", "fabric_mass_damping"})

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (SquareAcross(subject, self.name, θ[0]),)


EFFECT = AirLinearDrag()
