"""Making a case with somebody else's engine: garments, bodies, motions and questions are the generator's, the motion of the cloth is not.

The engine gets numbers only (`engines/mujoco_flex.py` says which) and makes the effects in its own way; here they are named, and given the
unit and the sign of the public names. What an engine cannot make is not asked of it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.exam.generator.causes import CAUSES, LIBRARY, WIND_DRAG, G, hem_mass, relative_density, tilted
from tasks.exam.generator.garments import Sheet
from tasks.exam.generator.membrane import POISSON
from tasks.exam.generator.observation import smoothed
from tasks.exam.generator.recording import Made, Sizes, recorded, shown, tracked
from tasks.exam.generator.rehearsal import ROUGHEST, least, rms, strength
from tasks.exam.generator.self_contact import SelfContact
from tasks.exam.generator.strata import Question
from tasks.exam.generator.subject import FPS, FRAMES, Subject, Tracker, Unmakeable, drawn_subject

Array = NDArray[np.float64]
Job = dict[str, Any]
Engine = Callable[[Job, Job | None], Mapping[str, Any]]  # a job, and one whose laws are compared with it
TICKS = 16  # per frame: as often the engine is told where bones and driven nodes are
SETTLING = 1.2  # s
SIGMA = 1e-3  # m: the same noise in all cases, so that what is left over on one null says something about the next case


@dataclass(frozen=True)
class Laws:
    """What the engine is to make of the cloth, none of it in the base: densities in kg/m², drags in m²/kg or 1/s, the rest in SI units.

    hem: width [m] of cloth whose mass lies on the free border; gradient: of the density, hem to top; stretched: ln of the scale of rest
    lengths; late [s]: the body after the garment; slip [m/s]: driven nodes creep down unseen; smoothing [s] of what is recorded.
    """

    friction: float = 0.2
    offset: float = 0.0
    gravity: tuple[float, float, float] = (0.0, -G, 0.0)
    damping: float = 0.0
    normal_drag: float = 0.0
    tangential_drag: float = 0.0
    linear_drag: float = 0.0
    wind: float = 0.0
    gusts: float = 0.0
    pressure: float = 0.0
    hem: float = 0.0
    gradient: float = 0.0
    stretched: float = 0.0
    late: float = 0.0
    slip: float = 0.0
    smoothing: float = 0.0


EFFECTS: dict[str, Callable[[Laws, float], Laws]] = {
    "air_normal_drag": lambda c, θ: replace(c, normal_drag=θ),
    "air_tangential_drag": lambda c, θ: replace(c, tangential_drag=θ),
    "air_linear_drag": lambda c, θ: replace(c, linear_drag=θ),
    "air_wind": lambda c, θ: replace(c, wind=θ),
    "fabric_mass_damping": lambda c, θ: replace(c, damping=θ),
    "fabric_density_gradient": lambda c, θ: replace(c, gradient=θ),
    "fabric_hem_mass": lambda c, θ: replace(c, hem=θ),
    "fabric_rest_scale": lambda c, θ: replace(c, stretched=θ),
    "contact_friction": lambda c, θ: replace(c, friction=c.friction + θ),
    "contact_thickness": lambda c, θ: replace(c, offset=c.offset + θ),
    "body_offset": lambda c, θ: replace(c, offset=c.offset + θ),
    "body_lag": lambda c, θ: replace(c, late=θ),
    "boundary_slip": lambda c, θ: replace(c, slip=θ),
    "observation_delay": lambda c, θ: replace(c, late=-θ),
    "observation_smoothing": lambda c, θ: replace(c, smoothing=np.sqrt(θ)),
    "observation_scale": lambda c, θ: replace(c, stretched=θ, gravity=(0.0, -G * np.exp(θ), 0.0)),
    "gravity_tilt": lambda c, θ: replace(c, gravity=tilted(θ)),
    "wind_gusts": lambda c, θ: replace(c, gusts=θ),
    "sleeve_pressure": lambda c, θ: replace(c, pressure=θ),
}
NAMES = tuple(name for name in EFFECTS if name in LIBRARY)
OUTSIDE = tuple(name for name in EFFECTS if name not in LIBRARY)
NAMES_AND_OUTSIDE = NAMES, OUTSIDE


def make_with(engine: Engine, q: Question, rng: np.random.Generator, share: float) -> Made:
    """The case from one draw; share: of the magnitude asked that its cause must reach. Raises ArithmeticError where the engine loses the
    cloth, Unmakeable where it cannot show its cause.
    """
    subject = drawn_subject(q, rng)
    subject = replace(subject, tracker=Tracker(SIGMA, subject.tracker.white, subject.tracker.dropped))
    fine, coarse = subject.garment.fine, subject.garment.coarse
    laws = Laws()
    plain = _motion(engine, subject, job(subject, fine, laws, 0))
    start = subject.reported(plain[0])
    coarse_plain = _motion(engine, subject, job(subject, coarse, laws, 0, start))
    numerics = rms(coarse_plain - subject.reported(plain))
    if numerics > ROUGHEST:
        raise Unmakeable(f"two meshes of it differ by {1e3 * numerics:.3g} mm")
    floor = float(np.hypot(subject.tracker.rms, numerics))
    strengths: dict[str, float] = {}
    settled = _motion(engine, subject, job(subject, coarse, laws, 0)) if q.causes else coarse_plain
    for name, multiple in q.causes.items():
        sign = -1.0 if CAUSES[name].symmetric and rng.uniform() < 0.5 else 1.0
        tried = partial(_rehearsed, engine, subject, name, plain=settled)
        strengths[name] = strength(CAUSES[name], tried, multiple * floor, least(multiple, share) * floor, sign)
        laws = EFFECTS[name](laws, strengths[name])
    first, change = plain, None
    if strengths:
        out = engine(job(subject, fine, laws, 0), job(subject, fine, Laws(), 0))
        first, change = _uncrossed(subject, fine, out["x"]), _changed(subject, out["change"])
    start = first[0] if laws.late <= 0 else None  # a body that is ahead stands elsewhere in every recording's first frame
    ways = (first, *(_motion(engine, subject, job(subject, fine, laws, k, start)) for k in (1, 2)))
    seen = [tracked(subject, k, subject.reported(x), laws.smoothing) for k, x in enumerate(ways)]
    moved = shown(seen[0], tracked(subject, 0, subject.reported(plain), 0.0), floor, asked=bool(strengths))
    return recorded(q, subject, seen, strengths, Sizes(moved, subject.tracker.rms, numerics), change, rng)


def job(subject: Subject, sheet: Sheet, laws: Laws, recording: int, start: Array | None = None) -> Job:
    """One run as the engine gets it; from rest at `start` [V, 3] m, or from where it comes to rest by itself."""
    s, ρ = subject.scenes[recording], subject.density
    times = np.arange(TICKS * (FRAMES - 1) + 1) / (TICKS * FPS)
    carried, down = s.carried(sheet.rest[sheet.pinned]), np.array([0, laws.slip, 0])
    turns, shifts = zip(*(s.pose(t + laws.late) for t in times), strict=True)
    return {
        "rest": sheet.rest * np.exp(laws.stretched),
        "faces": sheet.faces,
        "mass": _masses(sheet, ρ, laws),
        "stretch": subject.stretch,
        "bending": subject.bending,
        "poisson": POISSON,
        "start": s.carried(sheet.rest)(0.0) if start is None else start,
        "settling": SETTLING if start is None else 0.0,
        "driven": sheet.pinned,
        "places": np.stack([carried(t) - t * down for t in times]),
        "a": subject.body.a,
        "b": subject.body.b,
        "radius": subject.body.radius + laws.offset,
        "bone": subject.body.bone,
        "turns": np.stack(turns),
        "shifts": np.stack(shifts),
        "friction": laws.friction,
        "gravity": np.array(laws.gravity),
        "damping": laws.damping,
        "every": TICKS,
        "tick": 1 / (TICKS * FPS),
        "normal_drag": laws.normal_drag * ρ,
        "tangential_drag": laws.tangential_drag * ρ,
        "linear_drag": laws.linear_drag * ρ,
        "wind": laws.wind * np.array([np.cos(0.7), 0, np.sin(0.7)]),
        "wind_drag": WIND_DRAG * ρ if laws.wind or laws.gusts else 0.0,
        "gusts": laws.gusts,
        "pressure": laws.pressure,
    }


def _masses(sheet: Sheet, density: float, laws: Laws) -> Array:
    """Mass of every node [V] kg."""
    on_face = np.repeat(density * relative_density(sheet, laws.gradient) * sheet.areas / 3, 3)
    return np.bincount(sheet.faces.ravel(), on_face, minlength=len(sheet.rest)) + hem_mass(sheet, laws.hem * density)


def _motion(engine: Engine, subject: Subject, run: Job) -> Array:
    sheet = subject.garment.fine if len(run["rest"]) == len(subject.garment.fine.rest) else subject.garment.coarse
    return _uncrossed(subject, sheet, engine(run, None)["x"])


def _uncrossed(subject: Subject, sheet: Sheet, x: Array) -> Array:
    """x [T, V, 3]; the engine lets cloth pass through itself, which nothing that is examined could follow. Raises Unmakeable."""
    contact = SelfContact(sheet.rest, sheet.faces, subject.density)
    if any(contact.crosses(frame) for frame in x[::8]):
        raise Unmakeable("the cloth passes through itself")
    return x


def _rehearsed(engine: Engine, subject: Subject, name: str, θ: float, *, plain: Array) -> float:
    """Displacement [m] of the coarse mesh, whose base run is `plain`, under an effect of strength θ, as it would be recorded."""
    laws = EFFECTS[name](Laws(), θ)
    x = _motion(engine, subject, job(subject, subject.garment.coarse, laws, 0)) if CAUSES[name].moves else plain
    return rms(smoothed(x, FPS, laws.smoothing) - plain)


def _changed(subject: Subject, change: Array) -> Array:
    """Change of acceleration [C] on the coarse mesh, of free nodes."""
    squares = change**2
    squares[subject.garment.fine.pinned] = 0
    return np.sqrt(subject.garment.resampled(squares[:, None])[:, 0])
