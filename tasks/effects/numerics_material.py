"""The same of another material form: neo-Hookean beside the Saint Venant–Kirchhoff form of the base model.

    P = s (P_NH − P_StVK)        beside the base's, of an isotropic fabric

Both have the same constants and differ from the second order of the strain on. Nobody knows which a fabric is.

Strength: 1 is the other form [1]. Range: −1–1 (−1: away from it by as much, or back to StVK where the model is neo-Hookean).
Signature: where cloth is stretched or sheared by per cents.
Confounders: fabric_stiffening, fabric_orthotropy; it is integrated out, never named.
Source: `simulator.membrane_neohookean`; Li et al. 2021 (C-IPC). Limits: of orthotropic cloth the isotropic part is exchanged;
below zero the energy has no least value in cloth that is crushed to half its length.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.simulator.membrane_neohookean import MembraneNeoHookean
from tasks.simulator.membrane_stvk import MembraneStVK
from tasks.simulator.potential import NO_STIFFNESS, Array, Blocks, Potential, Step


class OtherForm(Potential):
    """Share s of the difference between the two forms."""

    parameters = ("numerics_material", "log_membrane", "log_rest_scale")

    def __init__(self, subject: Subject, share: float) -> None:
        isotropic = replace(subject.fabric, orthotropy=0.0)
        self.own, self.other = (form.of(subject.cloth, isotropic) for form in (MembraneStVK, MembraneNeoHookean))
        self.share = share

    @override
    def energy(self, x: Array, step: Step) -> float:
        return self.share * (self.other.energy(x, step) - self.own.energy(x, step)) if self.share else 0.0

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return self.share * self._force(x, step) if self.share else np.zeros_like(x)

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        if not self.share or convex:
            return NO_STIFFNESS
        own, other = (form.hessian(x, step, convex=False) for form in (self.own, self.other))
        return Blocks(own.stencils, self.share * (other.values - own.values))

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        if name == "numerics_material":
            return self._force(x, step)
        return self.share * (self.other.parameter_gradient(name, x, step) - self.own.parameter_gradient(name, x, step))

    def _force(self, x: Array, step: Step) -> Array:
        """∂P/∂x [V, 3] N of the whole difference."""
        return self.other.gradient(x, step) - self.own.gradient(x, step)


class NumericsMaterial(Effect):
    """The other form."""

    name = "numerics_material"
    kind = "potential"
    strengths = (Strength("share", "1", 1.0, -1.0, 1.0),)
    keeps = frozenset({"momentum", "gauge"})

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (OtherForm(subject, θ[0]),)


EFFECT = NumericsMaterial()
