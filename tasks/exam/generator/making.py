"""Making a case: strengths for the magnitude asked, recordings, and the truth about them."""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.exam.generator import observation
from tasks.exam.generator.causes import CAUSES, Conditions
from tasks.exam.generator.garments import Sheet
from tasks.exam.generator.rehearsal import numerics, rms, strength
from tasks.exam.generator.stepper import State, Stepper
from tasks.exam.generator.strata import Question, admissible, drawn
from tasks.exam.generator.subject import FPS, FRAMES, Subject, Unmakeable, drawn_subject, states
from tasks.geometry.meshes import boundary_edges

Array = NDArray[np.float64]
SHOWN = 0.5  # floors that the causes must reach on the fine mesh


@dataclass(frozen=True)
class Made:
    """Two open recordings, a blind one, and, to be locked away, the held-out one and the truth. Arrays by key of the tracked-geometry format."""

    recordings: tuple[dict[str, Any], ...]
    blind: dict[str, Any]
    held_out: dict[str, Any]
    truth: dict[str, Any]


def make(question: Question, *, attempts: int = 5) -> Made:
    """Make the case; a scene that cannot be simulated, or cannot show the cause at any plausible strength, is drawn again. Raises Unmakeable."""
    reasons = []
    for attempt in range(attempts):
        q = drawn(question, attempt) if attempt else question
        try:
            return make_once(q, np.random.default_rng([*question.seed, attempt, 1]))
        except ArithmeticError as error:
            reasons.append(f"{q.kind}: {error}")
    raise Unmakeable(f"case {question.number} {sorted(question.causes)}: {'; '.join(reasons)}")


def make_once(q: Question, rng: np.random.Generator) -> Made:
    """The case from one draw. Raises ArithmeticError where its scene cannot be simulated, Unmakeable where it cannot show its causes."""
    subject = drawn_subject(q, rng)
    base = subject.conditions(subject.garment.fine)
    stepper = Stepper(subject.world(base, 0))
    still = subject.still(stepper, 0)
    plain = np.stack([subject.reported(s.x) for s in states(stepper, still)])
    discretisation, coarse_plain = numerics(subject, plain)
    noise = np.sqrt(3) * subject.tracker.sigma
    floor = float(np.hypot(noise, discretisation))
    strengths, true = {}, base
    for name, multiple in q.causes.items():
        sign = -1.0 if CAUSES[name].symmetric and rng.uniform() < 0.5 else 1.0
        strengths[name] = strength(subject, name, multiple * floor, floor, coarse_plain, sign)
        true = CAUSES[name].apply(true, strengths[name])
    first, change = plain, None
    if strengths:
        first, still, change = _beside_base(subject, true, base)
    moved = rms(_tracked(subject, true, 0, first) - _tracked(subject, base, 0, plain))
    if strengths and moved < SHOWN * floor:
        raise Unmakeable(f"on the fine mesh its causes move it by {1e3 * moved:.3g} mm at a floor of {1e3 * floor:.3g} mm")
    runs = [first] + [_moved(subject, true, k, still) for k in (1, 2)]
    seen = [_tracked(subject, true, k, x) for k, x in enumerate(runs)]
    recordings = [_recording(subject, k, x, rng) for k, x in enumerate(seen)]
    truth = {
        "question": {
            "number": q.number,
            "stratum": q.stratum,
            "twist": q.twist,
            "withheld": q.withheld,
            "kind": q.kind,
            "motions": q.motions,
        },
        "causes": {n: {"strength": θ, "unit": CAUSES[n].unit, "asked_multiple": q.causes[n]} for n, θ in strengths.items()},
        "admissible": {n: sorted(admissible(n)) for n in strengths},
        "magnitude_mm": 1e3 * moved,
        "multiple": moved / floor,
        "floor_mm": 1e3 * floor,
        "noise_mm": 1e3 * noise,
        "numerics_mm": 1e3 * discretisation,
        "base": subject.numbers(),
        "local": any(CAUSES[n].local for n in strengths),
        "acceleration": None if change is None else change.tolist(),
    }
    return Made(tuple(recordings[:2]), _blinded(recordings[2]), recordings[2], truth)


def _moved(subject: Subject, c: Conditions, recording: int, start: State) -> Array:
    """Positions [T, C, 3] on the coarse mesh in a recording."""
    return np.stack([subject.reported(s.x) for s in states(Stepper(subject.world(c, recording)), start)])


def _beside_base(subject: Subject, true: Conditions, base: Conditions) -> tuple[Array, State, Array]:
    """The first recording, its start, and the change of acceleration [C] m/s² rms: between the laws with and without causes at the same states."""
    stepper, other = Stepper(subject.world(true, 0)), Stepper(subject.world(base, 0))
    start = subject.still(stepper, 0)
    x, squares = [], np.zeros(len(subject.garment.fine.rest))
    for state in states(stepper, start):
        x.append(subject.reported(state.x))
        normal_force = stepper.contact.normal_force
        squares += np.sum((stepper.accelerations(state) - other.accelerations(state)) ** 2, 1)
        stepper.contact.normal_force = normal_force
    squares[subject.garment.fine.pinned] = 0
    return np.stack(x), start, np.sqrt(subject.garment.resampled(squares[:, None])[:, 0] / FRAMES)


def _tracked(subject: Subject, c: Conditions, recording: int, x: Array) -> Array:
    """What a tracker without errors but with its smoothing reports; pinned nodes are where the body carries them, slip unseen."""
    coarse = subject.garment.coarse
    carried = subject.scenes[recording].carried(coarse.rest[coarse.pinned])
    x = x.copy()
    x[:, coarse.pinned] = np.stack([carried(t) for t in np.arange(len(x)) / FPS])
    return observation.smoothed(x, FPS, c.smoothing)


def _recording(subject: Subject, recording: int, x: Array, rng: np.random.Generator) -> dict[str, Any]:
    coarse, tracker, T = subject.garment.coarse, subject.tracker, len(x)
    ε = observation.noise(coarse.rest, T, FPS, tracker.sigma, rng, white=tracker.white)
    ε[:, coarse.pinned] = 0  # pinned nodes are known from what carries them
    seen = observation.dropouts(T, coarse.rest, tracker.dropped, rng)
    seen[:, coarse.pinned] = True
    collider, faces = subject.body.mesh(subject.scenes[recording].pose, np.arange(T) / FPS)
    arrays: dict[str, Any] = {
        "vertices": np.where(seen[..., None], x + ε, np.nan),
        "faces": coarse.faces,
        "fps": FPS,
        "observed": seen,
        "collider_vertices": collider,
        "collider_faces": faces,
        "boundary": coarse.pinned,
        "rest_vertices": coarse.rest,
        "up": "y",
        "noise_m": tracker.sigma,
        "zone": _zones(coarse),
    }
    if subject.garment.uv is not None:
        arrays["uv"] = subject.garment.uv
    if subject.base is not None:
        arrays["base"] = json.dumps(subject.base)
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
