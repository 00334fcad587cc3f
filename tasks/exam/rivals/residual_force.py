"""A nameless residual force: what is missing as an acceleration of every vertex, learnt from the residuals, without asking what it is.

    a_w = argmin Σ_t |r_w(t) − ½ a t²|² per window w and vertex: closes the gap where it was learnt;      ā = mean of a_w: what is carried over

On the blind motion ā acts as the dead force m ā; wrong starts of windows average out. What it is not: a cause; nothing in it can be named,
so it always answers "outside the library".

Source: simulators with a learnt residual (Golemo et al. 2018; Heiden et al. 2021, NeuralSim), their simplest form.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from typing_extensions import override

from tasks.effects.effect import Effect, Strength, Subject
from tasks.exam.rivals.rival import OUTSIDE, Array, Case, Reply, Rival
from tasks.gap.acceleration import fitted_acceleration
from tasks.gap.residual import rms_mm
from tasks.simulator.potential import NO_STIFFNESS, Blocks, Potential, Step


class DeadForce(Potential):
    """P = −f·x for forces f [V, 3] N that follow nothing."""

    def __init__(self, force: Array) -> None:
        self.force = force

    @override
    def energy(self, x: Array, step: Step) -> float:
        return -float(np.sum(self.force * x))

    @override
    def gradient(self, x: Array, step: Step) -> Array:
        return -self.force

    @override
    def hessian(self, x: Array, step: Step, *, convex: bool) -> Blocks:
        return NO_STIFFNESS


class ResidualForce(Effect):
    """An acceleration field [V, 3] m/s², as something that acts on cloth."""

    name = "residual_force"
    kind = "force"
    strengths = (Strength("share", "1", 1.0, 0.0, 1.0),)

    def __init__(self, acceleration: Array) -> None:
        self.acceleration = acceleration

    @override
    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        mass = subject.fabric.areal_density * subject.cloth.vertex_areas
        return (DeadForce(θ[0] * mass[:, None] * self.acceleration),)


def residual_force(case: Case) -> Reply:
    """Outside the library, with the mean of the windows' fields as the model that predicts."""
    _, base = case.refitted
    fps = case.model.subject.fps
    residuals = [e.residual for e in base.evidence if e.prediction.complete]
    fields = [np.nan_to_num(fitted_acceleration(r, fps)) for r in residuals]
    left = [r - parabola(a, len(r), fps) for r, a in zip(residuals, fields, strict=True)]
    mean = ResidualForce(np.mean(fields, 0))
    return Reply(
        {OUTSIDE: 0.0},
        before=base.model,
        after=replace(base.model, effects=(mean,), strengths={mean.name: np.ones(1)}),
        vertex_accel=np.sqrt(np.mean(np.sum(np.square(fields), -1), 0)),
        residual_mm=(rms_mm(np.concatenate(residuals)), rms_mm(np.concatenate(left))),
    )


def parabola(acceleration: Array, frames: int, fps: float) -> Array:
    """½ a t² [L, V, 3] m of a field [V, 3] m/s² at the frames after a window's start."""
    t = np.arange(1, frames + 1) / fps
    return 0.5 * t[:, None, None] ** 2 * acceleration


RIVAL = Rival(
    "residual_force",
    "learns the missing acceleration of every vertex and has no name for it",
    "Golemo et al. 2018, Heiden et al. 2021: simulators with a learnt residual",
    residual_force,
    slow=True,
    refits=True,
)
