"""Added mass: the air that cloth must push aside when it accelerates across itself.

    P = Σ_faces ½ m_a A (n·a)² s²,   a = mean of (x − x̃)/s² over the corners,   force −m_a A (n·a) n

It has inertia but no weight. n, A: normal and area of the face at the start of the step (lagged).
Strength: m_a/ρ̄ [-]. Range: m_a = 2ρ_a/k = ρ_a λ/π for waves of length λ (λ = 0.3 m: 0.11 kg/m²), about (π/4) ρ_a c for a panel of chord c
(0.5 m: 0.47 kg/m²), at ρ̄ 0.08–0.35 kg/m²: as much as the cloth itself.
Signature: normal only, in phase with the acceleration; swings and folds are slower; hanging shape and motion along the cloth stay.
Confounders: fabric_hem_mass and fabric_density_gradient (their weight pulls, this has none), fabric_mass_damping (out of phase).
Source: Lamb, Hydrodynamics, §§71, 231; Coltraro et al. 2021 split the inertial from the gravitational mass of real cloth for it.
Limits: a local law for what is a field: long waves carry more air than short ones; none between layers or next to the body. The rate
of the added momentum's direction is left out.
"""

from collections.abc import Sequence

from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.effects.faces_in_air import SquareAcross
from tasks.simulator.potential import Array, Potential, Step, StepTangent


class AddedMass(SquareAcross):
    """φ = ½ (a·n)², r being the acceleration."""

    @override
    def scale(self, step: Step) -> float:
        return step.s**2

    @override
    def origin(self, step: Step) -> Array:
        return step.x_tilde

    @override
    def origin_tangent(self, step: Step, d: StepTangent) -> Array:
        return d.x_hat + step.s * d.v_hat


class AirAddedMass(Effect):
    """Inertia of the air across the cloth."""

    name = "air_added_mass"
    kind = "potential"
    strengths = (Strength("m_a/ρ̄", "1", 1.0, 0.0, 5.0),)
    keeps = frozenset({"rest", "statics", "gauge"})
    confused_with = frozenset({"fabric_hem_mass", "fabric_density_gradient"})

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (AddedMass(subject, self.name, θ[0]),)


EFFECT = AirAddedMass()
