"""Hysteresis of shear: yarns that turn against each other rub, with a shear stress ±HG per length whatever the rate.

    P = HG Σ_faces Ā ∫ z dγ,   γ = 2E₁₂ between weft and warp,   z in [−1, 1] follows γ over γ_c = 5e-3 (`internal_friction`)

Weft and warp are those of the pattern; without one, warp is taken to run up the garment.
Strength: HG/ρ̄ [m²/s²]. Range: HG 0.25–2 N/m (half of KES 2HG) at ρ̄ 0.08–0.35 kg/m².
Signature: directions on the bias; elbows, knees and panels that swing in their plane; rate-independent.
Confounders: fabric_membrane_damping (twice the rate doubles it), shear stiffness, fabric_orthotropy.
Source: Kawabata 1980 (KES shear, hysteresis read at 0.5°, hence γ_c); Dahl 1968; Miguel et al. 2013. Limits: one law for both senses;
the memory starts empty; rest lengths of the mesh, also where fabric_rest_scale is at work.
"""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csc_matrix
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.effects.internal_friction import InternalFriction
from tasks.effects.stencil_levers import lever, strain_slopes
from tasks.simulator import Cloth, strain
from tasks.simulator.potential import Array, Blocks, Potential

BUILD_UP = 5e-3  # γ_c [-]


class ShearFriction(InternalFriction):
    """Friction of the shear between weft and warp."""

    def __init__(self, subject: Subject, name: str, strength: float) -> None:
        self.faces, (self.N, self.area) = subject.cloth.faces, _weave(subject.cloth)
        super().__init__(name, strength, subject.fabric.areal_density * self.area, np.full(len(self.faces), BUILD_UP))

    @override
    def deformation(self, x: Array) -> Array:
        return strain.metric(x, self.faces, self.N)[:, 2]

    @override
    def lever(self, x: Array) -> csc_matrix:
        return lever(self.faces, strain_slopes(x, self.faces, self.N)[:, 2], len(x))

    @override
    def stiffness(self, x: Array, moment: Array, slope: Array, *, convex: bool) -> Blocks:
        S, D = np.zeros((len(slope), 3)), np.zeros((len(slope), 3, 3))
        S[:, 2], D[:, 2, 2] = moment, slope
        return Blocks(self.faces, strain.hessian(x, self.faces, self.N, np.ones_like(slope), S, D, convex))


def _weave(cloth: Cloth) -> tuple[Array, Array]:
    """Shape gradients N [F, 3, 2] 1/m along weft and warp, and areas [F] m²."""
    N, area = strain.rest_frames(cloth.x_rest, cloth.faces, cloth.uv)
    if cloth.uv is not None:
        return N, area
    slopes = np.einsum("fpi,fpa->fai", cloth.x_rest[cloth.faces], N)  # the axes of the faces laid flat, in space [F, 2, 3]
    up = np.where(np.abs(slopes[:, :, 1]).max(1) > 0.1, 1, 2)  # y; z where a face lies flat
    warp = np.take_along_axis(slopes, up[:, None, None], 2)[:, :, 0]
    warp /= np.linalg.norm(warp, axis=1, keepdims=True)
    weft = np.stack([warp[:, 1], -warp[:, 0]], 1)
    return np.ascontiguousarray(np.einsum("fpa,fba->fpb", N, np.stack([weft, warp], 1))), area


class FabricShearHysteresis(Effect):
    """Internal friction of shear."""

    name = "fabric_shear_hysteresis"
    kind = "state"
    strengths = (Strength("HG/ρ̄", "m2/s2", 3.3, 0.0, 25.0),)
    keeps = frozenset({"momentum", "energy", "gauge"})
    confused_with = frozenset({"fabric_membrane_damping"})

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (ShearFriction(subject, self.name, θ[0]),)


EFFECT = FabricShearHysteresis()
