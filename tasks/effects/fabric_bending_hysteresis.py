"""Hysteresis of bending: yarns that rub hold a fold where it is, with a moment ±HB per length whatever the rate.

    P = HB Σ_hinges |ē| ∫ z dθ,   z in [−1, 1] follows the angle over θ_c = κ_c (Ā₁ + Ā₂)/|ē|,   κ_c = 5 1/m (`internal_friction`)

Strength: HB/ρ̄ [m³/s²]. Range: HB 1e-4–5e-4 N (KES 2HB 0.02–0.1 gf·cm/cm) at ρ̄ 0.08–0.35 kg/m²; with B = 5e-6–2e-5 N·m it locks
curvatures HB/B of 10–50 1/m.
Signature: folds that persist; cloth that stops sooner and stays; rate-independent; two drapes of one pose reached from two sides.
Confounders: fabric_bending_damping (measured |cos| 0.87; twice the rate doubles it), fabric_crease (does it come back?),
fabric_rest_curvature (drape from two sides), fabric_orthotropy (0.30).
Source: Dahl 1968; Miguel et al. 2013; Wong et al. 2013; Lahey & Heppler 2004; κ_c after Grosberg 1966: initial bending stiffness a few
times the later one. Limits: exact for bending about an edge direction of the mesh, up to 5/3 too much between them; the memory starts
empty, although the cloth remembers what was before the recording.
"""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csc_matrix
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.effects.internal_friction import InternalFriction
from tasks.effects.pattern_edges import hinge_spans
from tasks.effects.stencil_levers import lever
from tasks.geometry.meshes import edge_lengths
from tasks.simulator.hinge_bending import angle_gradients, angle_hessians, angles
from tasks.simulator.potential import Array, Blocks, Potential

BUILD_UP = 5.0  # κ_c [1/m]


class BendingFriction(InternalFriction):
    """Friction of the hinge angles."""

    def __init__(self, subject: Subject, name: str, strength: float) -> None:
        cloth = subject.cloth
        self.hinges = cloth.hinges
        length = edge_lengths(cloth.x_rest, self.hinges[:, :2])
        super().__init__(name, strength, subject.fabric.areal_density * length, BUILD_UP * hinge_spans(cloth))

    @override
    def deformation(self, x: Array) -> Array:
        return angles(x, self.hinges)

    @override
    def lever(self, x: Array) -> csc_matrix:
        return lever(self.hinges, angle_gradients(x, self.hinges), len(x))

    @override
    def stiffness(self, x: Array, moment: Array, slope: Array, *, convex: bool) -> Blocks:
        g = angle_gradients(x, self.hinges).reshape(-1, 12)
        H = np.einsum("k,ki,kj->kij", slope, g, g)
        return Blocks(self.hinges, H if convex else H + moment[:, None, None] * angle_hessians(x, self.hinges))


class FabricBendingHysteresis(Effect):
    """Internal friction of bending."""

    name = "fabric_bending_hysteresis"
    kind = "state"
    strengths = (Strength("HB/ρ̄", "m3/s2", 1.3e-3, 0.0, 7e-3),)
    keeps = frozenset({"momentum", "energy", "gauge"})
    confused_with = frozenset({"fabric_bending_damping", "fabric_crease", "fabric_rest_curvature"})

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (BendingFriction(subject, self.name, θ[0]),)


EFFECT = FabricBendingHysteresis()
