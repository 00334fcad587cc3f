"""Making a case: garment, body and motions, strengths found for the magnitude asked, recordings, and the truth about them."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.exam.generator import observation
from tasks.exam.generator.bodies import Body
from tasks.exam.generator.causes import CAUSES, Conditions
from tasks.exam.generator.fabric import Fabric
from tasks.exam.generator.garments import Garment, Sheet, cut, tailor
from tasks.exam.generator.scenes import Scene, body_of, scene
from tasks.exam.generator.stepper import State, Stepper, World
from tasks.exam.generator.strata import Question, admissible, drawn
from tasks.geometry.meshes import boundary_edges

Array = NDArray[np.float64]
FPS, FRAMES, SEARCHED = 30.0, 40, 22
STEPS, COARSE_STEPS = 2, 3  # steps per frame; other ones to measure the numerics
YOUNG_THICKNESS, HINGE = 0.076e6 * 0.328e-3, 6 * 0.076e6 * 0.328e-3**3 / (24 * (1 - 0.071**2))  # of κ_s = κ_b = 1: E₀t [N/m], B [N·m]
THICKNESS = 0.328e-3
STIFFEST = 450.0  # κ_b


class Unmakeable(ArithmeticError):
    """The cloth of this case passes through itself or has no motion; it must be drawn again."""


@dataclass(frozen=True)
class Made:
    """Two open recordings, a blind one, and, to be locked away, the held-out one and the truth. Arrays by key of the tracked-geometry format."""

    recordings: tuple[dict[str, Any], ...]
    blind: dict[str, Any]
    held_out: dict[str, Any]
    truth: dict[str, Any]


@dataclass(frozen=True)
class Subject:
    """What stays the same in all recordings of a case."""

    garment: Garment
    body: Body
    scenes: tuple[Scene, Scene, Scene]
    fabric: Fabric
    sigma: float
    white: float
    dropped: float


def make(question: Question, *, attempts: int = 5) -> Made:
    """Make the case; a scene that cannot be simulated, or cannot show the cause at any plausible strength, is drawn again. Raises Unmakeable."""
    for attempt in range(attempts):
        try:
            return _make(drawn(question, attempt) if attempt else question, np.random.default_rng([*question.seed, attempt, 1]))
        except ArithmeticError as error:
            reason = error
    raise Unmakeable(f"case {question.number} ({question.kind}, {question.causes}): {reason}")


def _make(q: Question, rng: np.random.Generator) -> Made:
    subject = _subject(q, rng)
    base = Conditions(subject.garment.fine, subject.fabric)
    plain, rest = _run(subject, base, 0, FRAMES)
    numerics = _numerics(subject, plain)
    noise = np.sqrt(3) * subject.sigma
    floor = float(np.hypot(noise, numerics))
    strengths = {name: _strength(subject, base, name, multiple * floor, plain, rng) for name, multiple in q.causes.items()}
    true = base
    for name, θ in strengths.items():
        true = CAUSES[name].apply(true, θ)
    first, change = plain, None
    if strengths:
        compared = Stepper(_world(subject.garment.fine, subject, base, 0))
        first, rest, change = _run_beside(subject, true, compared)
    runs = [first] + [_run(subject, true, k, FRAMES, rest)[0] for k in (1, 2)]
    seen = [_tracked(subject, true, k, x) for k, x in enumerate(runs)]
    moved = _rms(_smooth(seen[0], true) - plain)
    recordings = [_recording(q, subject, true, k, x, rng) for k, x in enumerate(seen)]
    truth = {
        "question": {"number": q.number, "stratum": q.stratum, "twist": q.twist, "withheld": q.withheld, "kind": q.kind, "motions": q.motions},
        "causes": {n: {"strength": θ, "unit": CAUSES[n].unit, "asked_multiple": q.causes[n]} for n, θ in strengths.items()},
        "admissible": {n: sorted(admissible(n)) for n in strengths},
        "magnitude_mm": 1e3 * moved,
        "multiple": moved / floor,
        "floor_mm": 1e3 * floor,
        "noise_mm": 1e3 * noise,
        "numerics_mm": 1e3 * numerics,
        "base": _base_numbers(subject.fabric),
        "local": any(CAUSES[n].local for n in strengths),
        "acceleration": None if change is None else change.tolist(),
    }
    return Made(tuple(recordings[:2]), _blinded(recordings[2]), recordings[2], truth)


def _subject(q: Question, rng: np.random.Generator) -> Subject:
    form = cut(q.kind, rng)
    garment = tailor(form, rng.integers(250, 290), rng.uniform(2.0, 2.3), rng)
    body = body_of(q.kind, rng)
    tilt = rng.uniform(0.5, 0.9)
    scenes = tuple(scene(q.kind, body, m, rng, tilt=tilt) for m in q.motions)
    sigma = float(rng.choice([0.5e-3, 1e-3, 2e-3, 4e-3], p=[0.3, 0.4, 0.2, 0.1]))
    white = {"white_noise": 1.0, "correlated_noise": 0.1}.get(q.twist, 0.5)
    dropped = float(rng.choice([0.0, 0.02, 0.05]))
    return Subject(garment, body, scenes, _fabric(garment, q, rng), sigma, white, dropped)


def _fabric(garment: Garment, q: Question, rng: np.random.Generator) -> Fabric:
    """Stretch 60–600 N/m, density 0.09–0.25 kg/m², bending such that cloth bends over 1.3 to 1.7 coarse edges (sometimes less)."""
    density = np.exp(rng.uniform(np.log(0.09), np.log(0.25)))
    if q.twist == "density":
        density *= rng.choice([0.5, 2.0])
    area = np.linalg.norm(np.cross(*np.moveaxis(garment.coarse.rest[garment.coarse.faces[:, 1:]] - garment.coarse.rest[garment.coarse.faces[:, :1]], 1, 0)), axis=1)
    edge = np.sqrt(area.mean() * 2 / np.sqrt(3))
    length = edge * (rng.uniform(1.3, 1.7) if rng.uniform() < 0.85 else rng.uniform(0.9, 1.3))
    stretch = np.exp(rng.uniform(np.log(60), np.log(600)))
    bending = min(density * 9.81 * length**3, STIFFEST * HINGE)
    return Fabric.even(garment.fine, float(density), float(stretch), float(bending))


def _world(sheet: Sheet, subject: Subject, c: Conditions, k: int) -> World:
    s = subject.scenes[k]
    carried = s.carried(sheet.rest[sheet.pinned])

    def pose(t: float) -> tuple[Array, Array]:
        return s.pose(t + c.body_late)

    def pinned(t: float) -> Array:
        return carried(t) - c.slip[0] * t * np.array([0, 1.0, 0])

    return World(sheet, c.fabric, s.body, pose, pinned, c.friction, c.offset, c.gravity, c.forces)


def _run(subject: Subject, c: Conditions, k: int, frames: int, start: State | None = None) -> tuple[Array, State]:
    """Positions [T, C, 3] on the coarse mesh in recording k, and the state of rest that it started from."""
    stepper = Stepper(_world(subject.garment.fine, subject, c, k))
    states = list(_states(subject, stepper, k, frames, start))
    return np.stack([subject.garment.resampled(s.x) for s in states]), states[0]


def _run_beside(subject: Subject, c: Conditions, other: Stepper) -> tuple[Array, State, Array]:
    """As `_run` for the first recording; also by how much accelerations differ from those of `other` at the same states [C] m/s², rms."""
    stepper = Stepper(_world(subject.garment.fine, subject, c, 0))
    x, squares = [], np.zeros(len(stepper.elements.mass))
    for state in _states(subject, stepper, 0, FRAMES, None):
        x.append(subject.garment.resampled(state.x))
        held = stepper.contact.normal_force
        squares += np.sum((stepper.accelerations(state) - other.accelerations(state)) ** 2, 1)
        stepper.contact.normal_force = held
        first = state if len(x) == 1 else first
    squares[subject.garment.fine.pinned] = 0
    return np.stack(x), first, np.sqrt(subject.garment.resampled(squares[:, None])[:, 0] / FRAMES)


def _states(subject: Subject, stepper: Stepper, k: int, frames: int, start: State | None) -> Iterator[State]:
    """The state of rest, or `start`, and what follows it frame by frame. Raises Unmakeable when the cloth passes through itself."""
    rest = start or stepper.rest(subject.scenes[k].carried(subject.garment.fine.rest)(0.0))
    for n, state in enumerate(stepper.frames(rest, np.arange(frames) / FPS, STEPS)):
        if n % 8 == 0 and stepper.self_contact.crosses(state.x):
            raise Unmakeable("the cloth passes through itself")
        yield state


def _numerics(subject: Subject, plain: Array) -> float:
    """What discretisation alone does: root mean square distance [m] of the base run from one on the coarse mesh in other steps.

    Both start from the same places, as a diagnosis would start from the first frame.
    """
    coarse = subject.garment.coarse
    f = subject.fabric
    even = Fabric.even(coarse, float(f.density[0]), float(f.stretch[0]), float(f.bending[0]))
    stepper = Stepper(_world(coarse, subject, Conditions(coarse, even), 0))
    still = np.zeros_like(plain[0])
    start = State(plain[0].copy(), still, still, 0.0, stepper.elements.memory(plain[0]))
    x = np.stack([s.x for s in stepper.frames(start, np.arange(FRAMES) / FPS, COARSE_STEPS)])
    return _rms(x - plain)


def _strength(subject: Subject, base: Conditions, name: str, wanted: float, plain: Array, rng: np.random.Generator) -> float:
    """Strength at which the cause moves the garment by `wanted` [m]: one trial, two where the first is far off, on a shorter run."""
    cause = CAUSES[name]
    sign = -1.0 if cause.symmetric and rng.uniform() < 0.5 else 1.0
    θ = cause.guess
    for _ in range(2):
        conditions = cause.apply(base, sign * θ)
        x = _run(subject, conditions, 0, SEARCHED)[0] if cause.moves else plain[:SEARCHED]
        moved = _rms(_smooth(x, conditions) - plain[:SEARCHED])
        ratio = wanted / max(LATER * moved, 1e-7)
        needed = θ * ratio ** (1 / cause.order)
        θ = float(np.clip(needed, 0.02 * cause.guess, cause.most))
        if 0.5 < ratio < 2 or not cause.moves:
            break
    if needed > 2 ** (1 / cause.order) * cause.most:
        raise Unmakeable(f"{name} at its strongest does not move the garment by {1e3 * wanted:.3g} mm, nor by half of it")
    return sign * θ


LATER = 1.4  # the first part of a recording shows about 1/1.4 of what the whole shows


def _smooth(x: Array, c: Conditions) -> Array:
    return observation.smoothed(x, FPS, c.smoothing)


def _tracked(subject: Subject, c: Conditions, k: int, x: Array) -> Array:
    """Where a perfect tracker would put the garment: pinned nodes where the body carries them, slip unseen."""
    coarse = subject.garment.coarse
    carried = subject.scenes[k].carried(coarse.rest[coarse.pinned])
    x = x.copy()
    x[:, coarse.pinned] = np.stack([carried(t) for t in np.arange(len(x)) / FPS])
    return x


def _recording(q: Question, subject: Subject, c: Conditions, k: int, x: Array, rng: np.random.Generator) -> dict[str, Any]:
    coarse, T = subject.garment.coarse, len(x)
    ε = observation.noise(coarse.rest, T, FPS, subject.sigma, rng, white=subject.white)
    ε[:, coarse.pinned] = 0  # pinned nodes are known from what carries them
    seen = observation.dropouts(T, coarse.rest, subject.dropped, rng)
    seen[:, coarse.pinned] = True
    collider, faces = subject.body.mesh(subject.scenes[k].pose, np.arange(T) / FPS)
    arrays: dict[str, Any] = {
        "vertices": np.where(seen[..., None], _smooth(x, c) + ε, np.nan),
        "faces": coarse.faces,
        "fps": FPS,
        "observed": seen,
        "collider_vertices": collider,
        "collider_faces": faces,
        "boundary": coarse.pinned,
        "rest_vertices": coarse.rest,
        "up": "y",
        "noise_m": subject.sigma,
        "zone": _zones(coarse),
    }
    if subject.garment.uv is not None:
        arrays["uv"] = subject.garment.uv
    if q.twist == "wrong_base":
        wrong = {n: v * float(np.exp(rng.choice([-1, 1]) * rng.uniform(0.5, 1.2))) for n, v in _base_numbers(subject.fabric).items()}
        arrays["base"] = json.dumps(wrong)
    return arrays


def _blinded(recording: dict[str, Any]) -> dict[str, Any]:
    """Garment in the first two frames only; boundary and collider throughout."""
    x, observed = recording["vertices"].copy(), recording["observed"].copy()
    unknown = np.setdiff1d(np.arange(x.shape[1]), recording["boundary"])
    x[2:, unknown] = np.nan
    observed[2:, unknown] = False
    return recording | {"vertices": x, "observed": observed}


def _zones(sheet: Sheet) -> NDArray[np.str_]:
    zone = np.full(len(sheet.rest), "free", dtype="<U8")
    zone[np.unique(boundary_edges(sheet.faces))] = "hem"
    zone[np.unique(sheet.seam)] = "seam"
    zone[sheet.pinned] = "pinned"
    return zone


def _base_numbers(fabric: Fabric) -> dict[str, float]:
    """The base parameters in the units of the project's reference cloth."""
    return {
        "density": float(fabric.density[0]) / THICKNESS,
        "membrane": float(fabric.stretch[0]) / YOUNG_THICKNESS,
        "bending": float(fabric.bending[0]) / HINGE,
    }


def _rms(d: Array) -> float:
    """√ mean |d|² of displacements [..., 3]."""
    return float(np.sqrt(np.mean(np.sum(d**2, -1))))

