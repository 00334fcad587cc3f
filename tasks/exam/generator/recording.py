"""A case as files: what a tracker makes of three runs, two of them open, one held out and shown blind; and the truth about them."""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.exam.generator import observation
from tasks.exam.generator.causes import CAUSES
from tasks.exam.generator.garments import Sheet
from tasks.exam.generator.rehearsal import rms
from tasks.exam.generator.strata import Question, admissible
from tasks.exam.generator.subject import FPS, Subject, Unmakeable
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


@dataclass(frozen=True)
class Sizes:
    """How far the causes move the first recording, and the two parts of the floor; root mean squares [m]."""

    moved: float
    noise: float
    numerics: float

    @property
    def floor(self) -> float:
        """floor² = noise² + numerics²."""
        return float(np.hypot(self.noise, self.numerics))


def shown(first: Array, plain: Array, floor: float, *, asked: bool) -> float:
    """Root mean square displacement [m] of the first recording by its causes. Raises Unmakeable where they were asked for and hardly move it."""
    moved = rms(first - plain)
    if asked and moved < SHOWN * floor:
        raise Unmakeable(f"on the fine mesh its causes move it by {1e3 * moved:.3g} mm at a floor of {1e3 * floor:.3g} mm")
    return moved


def recorded(
    q: Question,
    subject: Subject,
    seen: list[Array],
    strengths: dict[str, float],
    sizes: Sizes,
    change: Array | None,
    rng: np.random.Generator,
) -> Made:
    """The case of three runs as a perfect tracker sees them, `seen` [T, C, 3] m each; change [C] m/s²: of accelerations by the causes."""
    recordings = [reported(subject, k, x, rng) for k, x in enumerate(seen)]
    truth = {
        "question": {
            "number": q.number,
            "stratum": q.stratum,
            "twist": q.twist,
            "withheld": list(q.withheld),
            "kind": q.kind,
            "motions": q.motions,
        },
        "causes": {
            n: {"strength": θ, "unit": CAUSES[n].unit, "along": CAUSES[n].along, "asked_multiple": q.causes[n]}
            for n, θ in strengths.items()
        },
        "admissible": {n: sorted(admissible(n)) for n in strengths},
        "magnitude_mm": 1e3 * sizes.moved,
        "multiple": sizes.moved / sizes.floor,
        "floor_mm": 1e3 * sizes.floor,
        "noise_mm": 1e3 * sizes.noise,
        "numerics_mm": 1e3 * sizes.numerics,
        "base": subject.numbers(),
        "local": bool(strengths) and all(CAUSES[n].local for n in strengths),
        "acceleration": None if change is None else change.tolist(),
    }
    return Made(tuple(recordings[:2]), _blinded(recordings[2]), recordings[2], truth)


def tracked(subject: Subject, recording: int, x: Array, smoothing: float) -> Array:
    """What a tracker without errors but with its smoothing [s] reports; pinned nodes are where the body carries them, slip unseen."""
    coarse = subject.garment.coarse
    carried = subject.scenes[recording].carried(coarse.rest[coarse.pinned])
    x = x.copy()
    x[:, coarse.pinned] = np.stack([carried(t) for t in np.arange(len(x)) / FPS])
    return observation.smoothed(x, FPS, smoothing)


def reported(subject: Subject, recording: int, x: Array, rng: np.random.Generator) -> dict[str, Any]:
    """A recording as the subject's tracker reports it, of positions x [T, C, 3] m as a perfect one sees them; by key of the tracked-geometry format."""
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
