"""Seams that bend less: several layers and a thread along the lines where panels are sewn together.

    P = (e^r − 1) Σ_seam k (θ − θ̄)² |ē|/h̄

on the hinges whose edge lies on a seam: the pattern is cut there, or both ends are in the zone "seam".
Strength: r = ln of the ratio of hinge stiffness on the seam to that beside it [1]. Range: ratios of 3–20 (one or two more layers: 8, 27),
r 0–3; typical 2.
Signature: bending along known lines; folds that go around the seam or stop at it.
Confounders: fabric_rest_curvature of a puckered seam, fabric_orthotropy where all seams run one way.
Source: bending stiffness with the cube of the thickness; `simulator.hinge_bending`. Limits: hems are not among them; the seam's mass and
its stretch stay those of the cloth; one ratio for all seams; bends across the seam only, not along it.
"""

from collections.abc import Sequence

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.effects.pattern_edges import edges_in_pattern
from tasks.simulator.hinge_bending import HingeBending
from tasks.simulator.potential import NO_STIFFNESS, Array, Blocks, Potential, Step


class SeamBending(Potential):
    """The base's hinges of the seams, (e^r − 1) times over."""

    parameters = ("fabric_seam_stiffness", "log_bending")

    def __init__(self, subject: Subject, r: float) -> None:
        whole, on = HingeBending.of(subject.cloth, subject.fabric), seam_hinges(subject)
        self.unit = HingeBending(np.ascontiguousarray(whole.hinges[on]), whole.weight[on], whole.rest_angle[on])
        self.share, self.rate = float(np.expm1(r)), float(np.exp(r))

    @override
    def energy(self, x: Array, step: Step) -> float:
        return self.share * self.unit.energy(x, step) if self.share else 0.0

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return self.share * self.unit.gradient(x, step) if self.share else np.zeros_like(x)

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        share = max(self.share, 0.0) if convex else self.share
        if not share:
            return NO_STIFFNESS
        H = self.unit.hessian(x, step, convex=convex)
        return Blocks(H.stencils, share * H.values)

    @override
    def parameter_gradient(self, name: str, x: Array, step: Step) -> Array:
        return {"log_bending": self.share, "fabric_seam_stiffness": self.rate}[name] * self.unit.gradient(x, step)


def seam_hinges(subject: Subject) -> np.ndarray:
    """Which hinges [H] bool lie on a seam."""
    cloth = subject.cloth
    on = (subject.zone[cloth.hinges[:, :2]] == "seam").all(1)
    if cloth.uv is not None:
        sides = edges_in_pattern(cloth)
        on |= np.abs(sides[:, 0] - sides[:, 1]).max((1, 2)) > 1e-6
    return on


class FabricSeamStiffness(Effect):
    """Stiffer seams."""

    name = "fabric_seam_stiffness"
    kind = "potential"
    strengths = (Strength("r", "1", 2.0, 0.0, 3.0),)
    keeps = frozenset({"momentum", "gauge"})
    confused_with = frozenset({"fabric_rest_curvature", "fabric_orthotropy"})

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        return (SeamBending(subject, θ[0]),)


EFFECT = FabricSeamStiffness()
