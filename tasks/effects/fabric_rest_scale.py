"""A pattern cut larger or smaller than thought, or cloth that has shrunk: all rest lengths times e^s.

Strength: s = ln of the ratio of lengths [1]. Range: ±0.05 woven, knit to ±0.2; typical 0.02.
Signature: static sag or tightness everywhere that tension acts.
Confounders: membrane stiffness at one load, fabric_stiffening, fabric_orthotropy, observation_scale (the same but for gravity); loads of
several sizes tell.
Source: `simulator.membrane_stvk`. Limits: warp and weft alike; mass, rest angles and hinge stiffness stay those of the rest mesh.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from tasks.effects.effect import Effect, MeshDoubt, Strength
from tasks.simulator import Fabric


class FabricRestScale(Effect):
    """Rest lengths other than thought."""

    name = "fabric_rest_scale"
    kind = "potential"
    strengths = (Strength("s", "1", 0.02, -0.2, 0.2),)
    keeps = frozenset({"momentum", "gauge"})
    confused_with = frozenset({"fabric_stiffening", "fabric_orthotropy", "observation_scale"})

    @property
    @override
    def parameters(self) -> dict[str, tuple[str, ...]]:
        return {self.name: ("log_rest_scale",)}

    @override
    def fabric(self, fabric: Fabric, θ: Sequence[float]) -> Fabric:
        return replace(fabric, rest_scale=fabric.rest_scale * float(np.exp(θ[0])))

    @override
    def feigned(self, doubt: MeshDoubt) -> NDArray[np.float64]:
        return np.array([doubt.scale])


EFFECT = FabricRestScale()
