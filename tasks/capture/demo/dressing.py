"""Dressing the actor and moving the garments with the simulator and what the base model lacks: in the demo air, which the diagnosis has to
find.

Top and skirt are simulated apart, each against the part of the body that it can meet; they do not meet each other (the top ends above
the skirt's waist). Rest shape is the flat pattern: rest lengths from `uv`, rest angles zero. Before the first frame the garment
settles on the standing actor. The motion is simulated in segments that start from positions and velocities alone: a run that is
taken up again at the last segment gives the same bits as one that was never interrupted, for one implicit Euler step in `SEGMENT`
frames where BDF2 has no history yet.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tasks.capture.demo.actor import Actor, Attached, attach
from tasks.capture.demo.garments import Garment
from tasks.capture.demo.skirt import SkirtCut, skirt
from tasks.capture.demo.top import TopCut, top
from tasks.effects.air_normal_drag import EFFECT as AIR_NORMAL_DRAG
from tasks.effects.effect import Motion, Subject
from tasks.effects.library import library
from tasks.effects.model import Model
from tasks.geometry.meshes import submesh
from tasks.simulator.cloth import Cloth, Collider
from tasks.simulator.fabric import Fabric
from tasks.simulator.settings import Settings
from tasks.simulator.simulate import Frame

Array = NDArray[np.float64]
Faces = NDArray[np.int32]
State = tuple[Array, Array]
Unmodelled = Mapping[str, tuple[float, ...]]

SEGMENT = 10  # frames
SETTLING = 32  # frames of implicit Euler, which damps
COLLIDER_FACES = 2400
DRAG_COEFFICIENT = 1.2  # C_d of a plate face-on
GAP = 1.5e-3  # [m] kept between cloth and the decimated body, which departs from the body by about as much
ARMS, HEAD = (16, 17, 18, 19, 20, 21, *range(25, 55)), (15, 22, 23, 24)
MEETS = {"skirt": (0, 1, 2, 3, 4, 5, 6, 20, 21, *range(25, 55)), "top": (0, 3, 6, 9, 12, 13, 14, 16, 17)}  # joints whose skin it can touch


@dataclass(frozen=True)
class Fitting:
    """A garment on the actor: fabric, collider faces [F, 3] and motion [T, C, 3] m, boundary motion [T, B, 3] m, frames per second, and
    what the base model lacks: effect -> strengths in SI units (`tasks/effects`).
    """

    garment: Garment
    fabric: Fabric
    collider_faces: Faces
    collider_motion: Array
    boundary_motion: Array
    fps: float
    unmodelled: Unmodelled = field(default_factory=dict)


def fit(
    name: str, actor: Actor, fabric: Fabric, *, spacing: float, rng: np.random.Generator, unmodelled: Unmodelled | None = None
) -> Fitting:
    """Sew the garment `name` ("skirt" or "top") around the actor as she stands in frame 0, with triangles of edge `spacing` [m].

    unmodelled: what the base model lacks; drag in still air where nothing is given.
    """
    garment = cut(name, actor, spacing=spacing, rng=rng)
    carried = attach(garment.vertices[garment.boundary], actor, frame=0)
    faces, surface = _collider(actor, MEETS[name])
    transforms = actor.posed.transforms
    air = {AIR_NORMAL_DRAG.name: (DRAG_COEFFICIENT / fabric.areal_density,)}
    lacking = air if unmodelled is None else unmodelled
    return Fitting(garment, fabric, faces, surface.at(transforms), carried.at(transforms), actor.motion.fps, lacking)


def cut(name: str, actor: Actor, *, spacing: float, rng: np.random.Generator) -> Garment:
    """The garment alone, cut to the actor's measures in frame 0."""
    joints, body, weights = actor.posed.joints[0], actor.posed.vertices[0], actor.model.weights
    waist = 0.3 * joints[3, 1] + 0.7 * joints[6, 1]
    trunk = weights[:, ARMS].sum(1) < 0.3
    if name == "skirt":
        return skirt(body[trunk], SkirtCut(waist=waist), spacing=spacing, rng=rng)
    shoulder = (joints[16] - joints[17])[0] / 2
    measures = TopCut(hem=waist + 0.03, upper_edge=joints[[16, 17], 1].mean() - 0.11, strap_place=0.6 * shoulder)
    return top(body[trunk & (weights[:, HEAD].sum(1) < 0.3)], measures, spacing=spacing, rng=rng)


def wear(
    fitting: Fitting,
    *,
    have: Mapping[int, State] | None = None,
    keep: Callable[[int, Array, Array], None] = lambda frame, x, v: None,
    substeps: int = 4,
) -> Array:
    """Garment vertices [T, V, 3] m of all frames.

    `have` holds states (x, v) of frames already simulated, `keep` is called with each new one. Raises RuntimeError where a step ends
    without convergence, with the simulator's reason.
    """
    states = dict(have or {})
    if 0 not in states:
        states[0] = settle(fitting)
        keep(0, *states[0])
    last = len(fitting.boundary_motion) - 1
    for start in range(0, last, SEGMENT):
        stop = min(start + SEGMENT, last)
        if all(frame in states for frame in range(start, stop + 1)):
            continue
        for frame in _run(fitting, states[start], slice(start, stop + 1), Settings(substeps=substeps, **_COMMON)):
            if frame.index:
                states[start + frame.index] = (frame.x, frame.v)
                keep(start + frame.index, frame.x, frame.v)
    return np.stack([states[frame][0] for frame in range(last + 1)])


def settle(fitting: Fitting) -> State:
    """The garment at rest on the standing actor, in implicit Euler steps of a whole frame."""
    standing = np.zeros(SETTLING, int)
    settings = Settings(integrator="backward_euler", substeps=1, **_COMMON)
    *_, frame = _run(fitting, (fitting.garment.vertices, np.zeros_like(fitting.garment.vertices)), standing, settings)
    return frame.x, frame.v


_COMMON = {"contact_offset": GAP, "acceleration_tolerance": 1e-2}  # [m/s²]: 1e-2 over a step of 10 ms is 1e-6 m


def _run(fitting: Fitting, state: State, frames: slice | Array, settings: Settings):
    g = fitting.garment
    cloth = Cloth(g.vertices, g.faces, g.boundary, uv=g.uv_vertices[g.uv_faces], rest_angles="flat")
    subject = Subject(cloth, fitting.fabric, Collider(fitting.collider_faces), np.full(len(g.vertices), "free"), fitting.fps)
    known, strengths = library(), {name: np.array(θ) for name, θ in fitting.unmodelled.items()}
    model = Model(subject, settings, tuple(known[name] for name in strengths), strengths)
    for frame in model.run(Motion(fitting.collider_motion[frames], fitting.boundary_motion[frames]), *state):
        _require(frame, g.name)
        yield frame


def _require(frame: Frame, name: str) -> None:
    if not frame.converged:
        raise RuntimeError(f"simulating the {name}: {frame.ending}")


def _collider(actor: Actor, joints: tuple[int, ...]) -> tuple[Faces, Attached]:
    """The skin that moves with `joints`, decimated (Garland & Heckbert 1997) in the rest pose; faces and attached vertices."""
    import igl

    model = actor.model
    region, kept = submesh(model.faces, model.skin & (model.weights[:, joints].sum(1) > 0.3))
    x, faces, *_ = igl.qslim(np.asfortranarray(actor.rest.vertices[kept]), np.asfortranarray(region.astype(np.int64)), COLLIDER_FACES)
    return np.ascontiguousarray(faces, np.int32), attach(np.ascontiguousarray(x), actor)
