"""Stretch that stiffens as threads straighten.

    ψ = ½ E t (q + ½ c q²),   q = Eᵀ𝔻E/(E t);   under uniaxial stress q = ε², σ = E t ε (1 + c ε²)

𝔻: the base membrane's stiffness, orthotropy included. q is convex in the Green strain and never negative, hence so is ψ for c ≥ 0.
Strength: c [1], the stiffness doubles by the strain 1/√c. Range: woven cloth stiffens from 1–5 % on, c 400–10⁴; knit 10–40 %, c 6–100.
Signature: only where the cloth is loaded: shoulders, waist, knees, and the peaks of a swing.
Confounders: fabric_rest_scale at one load (measured |cos| 0.24); loads of several sizes tell.
Source: Fung 1967, the first two terms of ψ = E t (e^{cq} − 1)/(2c); Wang, O'Brien, Ramamoorthi 2011 for strains. Limits: compression
stiffens as well, which folds hide; all directions and shear stiffen together.
"""

from collections.abc import Sequence

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.simulator import strain
from tasks.simulator.membrane_stvk import MembraneStVK
from tasks.simulator.potential import NO_STIFFNESS, Array, Blocks, Potential, Step


class Stiffening(Potential):
    """The second term, ¼ c (Eᵀ𝔻E)²/(E t), on the frames of the base membrane."""

    parameters = ("fabric_stiffening", "log_membrane", "log_rest_scale", "orthotropy")

    def __init__(self, subject: Subject, c: float) -> None:
        self.membrane = MembraneStVK.of(subject.cloth, subject.fabric)
        self.c, self.Et = c, subject.fabric.stretch_stiffness

    @override
    def energy(self, x: Array, step: Step) -> float:
        if not self.c:
            return 0.0
        E, S = self._strain(x)
        return 0.25 * self.c / self.Et * float(self.membrane.area @ np.sum(E * S, 1) ** 2)

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return self.c * self._unit(x) if self.c else np.zeros_like(x)

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        if not self.c:
            return NO_STIFFNESS
        m, (E, S) = self.membrane, self._strain(x)
        Q = np.sum(E * S, 1)
        D = self.c / self.Et * (Q[:, None, None] * m.D + 2 * S[:, :, None] * S[:, None, :])
        stress = self.c / self.Et * Q[:, None] * S
        return Blocks(m.faces, strain.hessian(x, m.faces, m.N, m.area, stress, D, convex))

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        if name == "fabric_stiffening":
            return self._unit(x)
        if not self.c or name == "log_membrane":
            return self.gradient(x, step)
        E, S = self._strain(x)
        if name == "log_rest_scale":
            dE = -(2 * E + (1.0, 1.0, 0.0))
            dQ, dS = 2 * np.sum(S * dE, 1), _apply(self.membrane.D, dE)
        else:
            dS = _apply({"orthotropy": self.membrane.D_orthotropy}[name], E)
            dQ = np.sum(E * dS, 1)
        return self._forces(x, self.c / self.Et * (dQ[:, None] * S + np.sum(E * S, 1)[:, None] * dS))

    def _unit(self, x: Array) -> Array:
        E, S = self._strain(x)
        return self._forces(x, np.sum(E * S, 1)[:, None] * S / self.Et)

    def _forces(self, x: Array, stress: Array) -> Array:
        m = self.membrane
        return strain.gradient(x, m.faces, m.N, m.area, stress)

    def _strain(self, x: Array) -> tuple[Array, Array]:
        """Strain E and base stress 𝔻E [F, 3] in Voigt order."""
        m = self.membrane
        E = strain.metric(x, m.faces, m.N) * (0.5, 0.5, 1.0) - (0.5, 0.5, 0.0)
        return E, _apply(m.D, E)


def _apply(D: Array, E: Array) -> Array:
    return np.einsum("fij,fj->fi", D, E)


class FabricStiffening(Effect):
    """Strain stiffening."""

    name = "fabric_stiffening"
    kind = "potential"
    strengths = (Strength("c", "1", 400.0, 0.0, 1e4),)
    keeps = frozenset({"momentum", "gauge"})
    confused_with = frozenset({"fabric_rest_scale"})

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (Stiffening(subject, θ[0]),)


EFFECT = FabricStiffening()
