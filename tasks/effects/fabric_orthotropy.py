"""Orthotropy of stretch: threads of warp and weft that are not equally stiff.

    E_u = E e^a along the weft,   E_v = E e^−a along the warp,   ψ = ½ Eᵀ 𝔻 E  (`simulator.membrane_stvk`)

Strength: a = ½ ln(E_u/E_v) [1]. Range: ratios of 1/10–10, a within ±1.2; typical 2.
Signature: strains differ between warp and weft; cone folds at panels; only where the cloth pulls.
Confounders: fabric_rest_scale at one load, fabric_seam_stiffness where seams run one way; several directions of load tell.
Source: Wang, O'Brien, Ramamoorthi 2011; Clyde, Teran, Tamstorf 2017. Limits: without a pattern the two directions are those of each
triangle's first edge, which mean nothing; shear and bending stay isotropic; E_u E_v > ν² E² holds for all a.
"""

from collections.abc import Sequence
from dataclasses import replace

from typing_extensions import override

from tasks.effects.effect import Effect, Strength
from tasks.simulator import Fabric


class FabricOrthotropy(Effect):
    """Weft stiffer than warp."""

    name = "fabric_orthotropy"
    kind = "potential"
    strengths = (Strength("a", "1", 0.35, -1.2, 1.2),)
    keeps = frozenset({"momentum", "gauge"})
    confused_with = frozenset({"fabric_rest_scale", "fabric_seam_stiffness"})

    @property
    @override
    def parameters(self) -> dict[str, tuple[str, ...]]:
        return {self.name: ("orthotropy",)}

    @override
    def fabric(self, fabric: Fabric, θ: Sequence[float]) -> Fabric:
        return replace(fabric, orthotropy=fabric.orthotropy + θ[0])


EFFECT = FabricOrthotropy()
