"""The small scenes that the tests of the effects share: a hanging panel, driven and struck by a ball, hanging still, draped, or flying free."""

from dataclasses import replace
from functools import cache

import numpy as np

from tasks.effects.effect import Effect, Motion, Subject
from tasks.effects.model import Model
from tasks.simulator import Cloth, Collider, Fabric, Settings
from tests.simulator.scenes import sheet, sphere

SIDE = 6  # vertices
LENGTH = 0.3  # [m]
FPS = 30.0
FRAMES = 11
FABRIC = Fabric(density=0.15 / 0.328e-3, membrane=2.0, bending=20.0, friction=0.2)
TIGHT = Settings(substeps=1, acceleration_tolerance=1e-8)


def panel(boundary: bool = True) -> Cloth:
    """A vertical square with its first row, the top, prescribed; u runs along x, v up."""
    flat, faces = sheet(SIDE, SIDE, length=LENGTH, width=LENGTH)
    x = np.stack([flat[:, 2], -flat[:, 0], np.zeros(len(flat))], 1)
    uv = np.ascontiguousarray(x[faces][:, :, :2])
    return Cloth(x, faces, np.arange(SIDE) if boundary else np.empty(0, np.int32), uv)


def subject(cloth: Cloth, faces: np.ndarray, fabric: Fabric = FABRIC) -> Subject:
    """The panel with its top pinned, its last row the hem and a vertical seam in the middle."""
    zone = np.full(len(cloth.x_rest), "free", "<U7")
    zone[SIDE // 2 :: SIDE] = "seam"
    zone[-SIDE:] = "hem"
    zone[cloth.boundary] = "pinned"
    return Subject(cloth, fabric, Collider(faces), zone, FPS)


@cache
def struck(fabric: Fabric = FABRIC) -> tuple[Subject, Motion, np.ndarray, np.ndarray]:
    """(subject, motion, x0, v0): the top sways, lifts at one end and turns, while a ball swings into the cloth and rubs along it."""
    cloth = panel()
    ball, faces = sphere(1, 0.07)
    t = np.arange(FRAMES)[:, None] / FPS
    top = cloth.x_rest[cloth.boundary]
    arm = top[:, 0] - LENGTH / 2
    along, lift, across = 0.05 * np.sin(7 * t), 0.02 * arm / LENGTH * np.sin(9 * t), 0.07 * np.sin(6 * t) + 0.3 * arm * np.sin(5 * t)
    sway = np.stack([along + 0 * arm, lift, across], 2)
    path = np.stack([0.15 + 0.3 * t[:, 0], -0.17 - 0.2 * t[:, 0], 0.2 - 0.3 * t[:, 0]], 1)
    motion = Motion(ball + path[:, None], top + sway)
    x0 = cloth.x_rest.copy()
    hang = -x0[:, 1] / LENGTH
    v0 = np.stack([0.35 + 0.1 * hang, 0.1 * hang * np.sin(20 * x0[:, 0]), 0.42 + 1.5 * (x0[:, 0] - LENGTH / 2) + 0.6 * np.sin(3 * hang)], 1)
    return subject(cloth, faces, fabric), motion, x0, v0


@cache
def flying(fabric: Fabric = FABRIC) -> tuple[Subject, Motion, np.ndarray, np.ndarray]:
    """Free cloth that turns and wrinkles in flight, touching nothing."""
    cloth = panel(boundary=False)
    x0 = cloth.x_rest + np.array([0, 0, 0.01]) * np.sin(25 * cloth.x_rest[:, :1])
    hang = -x0[:, 1] / LENGTH
    v0 = np.stack([0.5 + 0.2 * hang, 0.2 * np.sin(15 * x0[:, 0]), 0.6 * np.cos(9 * x0[:, 0]) + hang], 1)
    return subject(cloth, np.empty((0, 3), np.int32), fabric), Motion(np.zeros((FRAMES, 0, 3)), np.zeros((FRAMES, 0, 3))), x0, v0


@cache
def hanging() -> tuple[Subject, Motion, np.ndarray, np.ndarray]:
    """Cloth that hangs still and touches nothing."""
    cloth = panel()
    return _settled(subject(cloth, np.empty((0, 3), np.int32)), np.zeros((0, 3)))


@cache
def draped() -> tuple[Subject, Motion, np.ndarray, np.ndarray]:
    """Cloth at rest that a ball holds aside."""
    ball, faces = sphere(1, 0.07)
    return _settled(subject(panel(), faces), ball + np.array([0.15, -0.2, -0.072]), 0.03)


def _settled(s: Subject, collider: np.ndarray, push: float = 0.0) -> tuple[Subject, Motion, np.ndarray, np.ndarray]:
    slow = Subject(s.cloth, replace(s.fabric, friction=0.0), s.collider, s.zone, 1.0)
    frames = 40
    way = np.clip(np.linspace(0, 4, frames), 0, 1)[:, None, None] * np.array([0, 0, push])
    motion = Motion(collider + way, np.tile(s.cloth.x_rest[s.cloth.boundary], (frames, 1, 1)))
    settings = replace(TIGHT, integrator="backward_euler", substeps=1)
    last = list(Model(slow, settings).run(motion, s.cloth.x_rest, 0 * s.cloth.x_rest))[-1]
    assert last.converged, last.ending
    still = Motion(np.tile(last.collider, (FRAMES, 1, 1)), motion.boundary[:FRAMES])
    return Subject(s.cloth, slow.fabric, s.collider, s.zone, FPS), still, last.x, np.zeros_like(last.x)


def walk(
    scene: tuple, effects: tuple[Effect, ...] = (), strengths: dict | None = None, *, settings: Settings = TIGHT, columns: bool = False
):
    """All frames of a scene under effects, each of them converged, and the model."""
    s, motion, x0, v0 = scene
    model = Model(s, settings, effects, strengths or {})
    frames = list(model.run(motion, x0, v0, columns=columns))
    assert frames[-1].converged, frames[-1].ending
    return frames, model


def seen(scene: tuple, effect: Effect, θ: np.ndarray, **others) -> np.ndarray:
    """What is observed [T, V, 3] m of a scene under one effect."""
    frames, model = walk(scene, (effect,), {effect.name: θ}, **others)
    return model.observed(np.stack([f.x for f in frames]))


def signature(frames: list, model: Model, effect: Effect) -> dict[str, np.ndarray]:
    """column -> ∂(observed)/∂θ [T, V, 3] of one effect as the service computes it, from a walk with `columns`."""
    tangents = {c: np.stack([f.tangents[c][0] for f in frames]) for c in effect.columns if c in frames[0].tangents}
    return model.observed_tangents(np.stack([f.x for f in frames]), tangents)
