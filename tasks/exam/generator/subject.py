"""What stays the same in all recordings of a case: garment, body, motions, fabric, tracker. And its motion under given conditions."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.exam.generator.bodies import Body
from tasks.exam.generator.causes import Conditions
from tasks.exam.generator.fabric import Fabric
from tasks.exam.generator.garments import Garment, Sheet, cut, tailor
from tasks.exam.generator.scenes import Scene, body_of, scene
from tasks.exam.generator.stepper import State, Stepper, World
from tasks.exam.generator.strata import Question
from tasks.geometry.meshes import face_areas

Array = NDArray[np.float64]
FPS, FRAMES = 30.0, 40
STEPS = 2  # per frame
REFERENCE_THICKNESS = 0.328e-3  # t of the reference cloth in whose units base parameters are given [m]
REFERENCE_STRETCH = 0.076e6 * REFERENCE_THICKNESS  # κ_s = 1 [N/m]
REFERENCE_BENDING = 6 * 0.076e6 * REFERENCE_THICKNESS**3 / (24 * (1 - 0.071**2))  # κ_b = 1 [N·m]
STIFFEST = 450.0  # κ_b
MISTOLD = 0.2  # share of the cases with a cause whose base parameters are told, wrongly, as those of one null in four are


class Unmakeable(ArithmeticError):
    """What was drawn cannot be asked about: it passes through itself, is chaotic, or cannot show its cause."""


class TooFaint(Unmakeable):
    """Its cause, at its strongest, moves it by `share` of what was asked."""

    def __init__(self, message: str, share: float) -> None:
        super().__init__(message)
        self.share = share


@dataclass(frozen=True)
class Tracker:
    """Standard deviation of errors [m], share of their variance that is white, share of what is not seen."""

    sigma: float
    white: float
    dropped: float

    @property
    def rms(self) -> float:
        """Root mean square of the errors of a point [m]."""
        return float(np.sqrt(3) * self.sigma)


@dataclass(frozen=True)
class Subject:
    """A case without its cause. base: what the diagnosis is told of the fabric (nothing, or something wrong)."""

    garment: Garment
    body: Body
    scenes: tuple[Scene, ...]
    density: float
    stretch: float
    bending: float
    tracker: Tracker
    base: dict[str, float] | None

    def conditions(self, sheet: Sheet) -> Conditions:
        """No cause: the base fabric on the fine or the coarse sheet."""
        return Conditions(sheet, Fabric.even(sheet, self.density, self.stretch, self.bending))

    def numbers(self) -> dict[str, float]:
        """The base parameters in the units of the project's reference cloth: ρ [kg/m³], κ_s, κ_b."""
        return {
            "density": self.density / REFERENCE_THICKNESS,
            "membrane": self.stretch / REFERENCE_STRETCH,
            "bending": self.bending / REFERENCE_BENDING,
        }

    def world(self, c: Conditions, recording: int) -> World:
        """All that acts on the sheet of the conditions in one recording."""
        s = self.scenes[recording]
        carried = s.carried(c.sheet.rest[c.sheet.pinned])

        def pose(t: float) -> tuple[Array, Array]:
            return s.pose(t + c.body_late)

        def pinned(t: float) -> Array:
            return carried(t) - c.slip * max(t, 0.0) * np.array([0, 1.0, 0])

        return World(c.sheet, c.fabric, s.body, pose, pinned, c.friction, c.offset, c.gravity, c.forces, min(-c.body_late, 0.0))

    def still(self, stepper: Stepper, recording: int) -> State:
        """The cloth hanging still when the motion of a recording begins: before its first frame where the body is ahead of what is recorded."""
        return stepper.rest(self.scenes[recording].carried(stepper.world.sheet.rest)(0.0))

    def reported(self, x: Array) -> Array:
        """Positions [V, 3] or [T, V, 3] of either sheet on the coarse mesh."""
        if x.shape[-2] == len(self.garment.coarse.rest):
            return x
        return self.garment.tracked(x) if x.ndim == 2 else np.stack([self.garment.tracked(frame) for frame in x])


def drawn_subject(q: Question, rng: np.random.Generator, *, vertices: int | None = None) -> Subject:
    """A garment of the question's kind with everything else at random; vertices: about how many its coarse mesh has (default: 250 to 290),
    of the same fabric whatever it is.

    Stretch 60–600 N/m, density 0.09–0.25 kg/m², bending such that cloth bends over 1.3 to 1.7 coarse edges (sometimes less).
    """
    form, usual = cut(q.kind, rng), int(rng.integers(250, 290))
    garment = tailor(form, vertices or usual, rng.uniform(2.0, 2.3), rng)
    body, tilt, vigour = body_of(q.kind, rng), rng.uniform(0.5, 0.9), rng.uniform(0.5, 0.9)
    scenes = tuple(scene(q.kind, body, m, rng, vigour=vigour, tilt=tilt) for m in q.motions)
    density = np.exp(rng.uniform(np.log(0.09), np.log(0.25)))
    if q.twist == "density":
        density *= rng.choice([0.5, 2.0])
    edge = np.sqrt(4 / np.sqrt(3) * face_areas(garment.coarse.rest, garment.coarse.faces).mean() * (vertices or usual) / usual)
    length = edge * (rng.uniform(1.3, 1.7) if rng.uniform() < 0.85 else rng.uniform(0.9, 1.3))
    bending = min(density * 9.81 * length**3, STIFFEST * REFERENCE_BENDING)
    stretch = np.exp(rng.uniform(np.log(60), np.log(600)))
    sigma = rng.choice([0.5e-3, 1e-3, 2e-3, 4e-3], p=[0.3, 0.4, 0.2, 0.1])
    white = {"white_noise": 1.0, "correlated_noise": 0.1, "plain": 0.5}.get(q.twist) or float(
        rng.choice([1.0, 0.5, 0.1], p=[0.2, 0.6, 0.2])
    )
    tracker = Tracker(float(sigma), white, float(rng.choice([0.0, 0.02, 0.05])))
    subject = Subject(garment, body, scenes, float(density), float(stretch), float(bending), tracker, None)
    if q.twist != "wrong_base" and (q.stratum == "null" or rng.uniform() > MISTOLD):
        return subject
    wrong = {n: v * float(np.exp(rng.choice([-1, 1]) * rng.uniform(0.5, 1.2))) for n, v in subject.numbers().items()}
    return Subject(garment, body, scenes, subject.density, subject.stretch, subject.bending, tracker, wrong)


def states(stepper: Stepper, start: State, steps: int = STEPS, *, frames: int = FRAMES) -> Iterator[State]:
    """The state at every frame, from one at time 0 or before. Raises Unmakeable when the cloth passes through itself."""
    led_in = int(np.ceil(-start.t * FPS))
    times = [*np.linspace(start.t, 0, led_in, endpoint=False), *np.arange(frames) / FPS]
    for n, state in enumerate(stepper.frames(start, times, steps)):
        if n % 8 == 0 and stepper.self_contact.crosses(state.x):
            raise Unmakeable("the cloth passes through itself")
        if n >= led_in:
            yield state
