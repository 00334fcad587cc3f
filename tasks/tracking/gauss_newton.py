"""One instant: photometric + ISO + normal energy, minimised coarse to fine by damped Gauss–Newton.

E(x) = P_photo(x) + P_iso(x) + P_normal(x) + ½ Σ_v w_v |x_v − anchor_v|²

At each blur: find what is visible, linearise, solve (H + λI)δ = −∇E, and take δ if E falls (visibility held fixed); λ falls after a
success and rises after a failure (Levenberg–Marquardt, Nocedal & Wright 2006 §10.3). The level ends when the mean step is small
against the blur, when λ finds no descent, or after a set number of steps. Visibility is renewed after every step taken.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.cameras import Cameras
from tasks.tracking import blocks, isometry, normal_consistency, photometric
from tasks.tracking.pyramid import Level
from tasks.tracking.reference import Reference
from tasks.tracking.settings import Settings
from tasks.tracking.surface import Shape, Surface
from tasks.tracking.visibility import Occluder, facing_cosines

Array = NDArray[np.float64]

_REFUSALS = 3
_RISE, _FALL = 10.0, 0.2


@dataclass(frozen=True)
class Scene:
    """What stays the same over the sequence."""

    surface: Surface
    cameras: Cameras
    reference: Reference
    settings: Settings


@dataclass(frozen=True)
class Instant:
    """What belongs to one frame: image levels coarse to fine, the shape aimed at, and what stands in the way."""

    levels: tuple[Level, ...]
    shape: Shape
    occluder: Occluder | None


@dataclass(frozen=True)
class Fit:
    """x [V, 3] m; weight [sample, camera] of the last visibility; system at x and at the finest blur; mean last step m; how it ended."""

    x: Array
    weight: NDArray[np.float32]
    system: blocks.NormalEquations
    last_step: float
    ending: str


def fit(scene: Scene, instant: Instant, start: Array) -> Fit:
    """Bring the surface from `start` [V, 3] m to where the images of this instant are explained."""
    x, ends = start, []
    for number in range(len(instant.levels)):
        x, step, end = _descend(scene, instant, number, x)
        ends.append(f"{instant.levels[number].blur:g} px {end}")
    weight = visible(scene, instant, x)
    _, system = linearise(scene, instant, len(instant.levels) - 1, x, weight)
    return Fit(x, weight, system, step, ", ".join(ends))


def visible(scene: Scene, instant: Instant, x: Array) -> NDArray[np.float32]:
    """Facing cosines [sample, camera] of samples that are seen from their better side and have a reference; else 0."""
    cosine = facing_cosines(
        x, scene.surface, scene.cameras, occluder=instant.occluder, side=scene.reference.side, facing=scene.settings.facing, settings=scene.settings
    )
    return np.abs(cosine) * scene.reference.known[:, None]


def linearise(scene: Scene, instant: Instant, number: int, x: Array, weight: NDArray[np.float32]) -> tuple[float, blocks.NormalEquations]:
    """Energy and normal equations at x for level `number`, with visibility `weight`."""
    surface, settings, shape = scene.surface, scene.settings, instant.shape
    e1, *photo = photometric.derivatives(
        x, surface.faces, surface.barycentric, level=instant.levels[number], cameras=scene.cameras, weight=weight,
        reference=scene.reference.colour[number], sigma=settings.sigma_colour,
    )  # fmt: skip
    e2, *iso = isometry.derivatives(x, surface.edges, shape.rest, surface.edge_weight)
    e3, *normal = normal_consistency.derivatives(x, surface.hinges, shape.bend, weight=settings.sigma_normal**-2)
    system = blocks.assemble(surface.pattern, [tuple(photo), tuple(iso), tuple(normal)], diagonal=shape.anchor_weight)
    away = x - shape.anchor
    system.gradient[:] += shape.anchor_weight[:, None] * away
    return float(e1.sum() + e2.sum() + e3.sum() + 0.5 * shape.anchor_weight @ (away**2).sum(1)), system


def _descend(scene: Scene, instant: Instant, number: int, x: Array) -> tuple[Array, float, str]:
    """Steps at one level: (x, mean length of the last step [m], how it ended)."""
    settings = scene.settings
    enough = settings.settled_px * instant.levels[number].blur * _pixel(scene.cameras, x)
    λ, refused, step = settings.damping, 0, np.inf
    weight = visible(scene, instant, x)
    energy, system = linearise(scene, instant, number, x, weight)
    for k in range(settings.steps[number]):
        δ, _ = blocks.solve(system, damping=λ)
        δ *= np.minimum(1.0, settings.largest_step / np.maximum(np.linalg.norm(δ, axis=1), 1e-12))[:, None]
        trial, trial_system = linearise(scene, instant, number, x + δ, weight)
        if not trial < energy:
            λ, refused = λ * _RISE, refused + 1
            if refused > _REFUSALS:
                return x, step, f"found no descent after {k + 1} steps"
            continue
        x, step = x + δ, float(np.linalg.norm(δ, axis=1).mean())
        λ, refused = max(λ * _FALL, settings.damping), 0
        if step < enough:
            return x, step, f"settled after {k + 1} steps"
        weight = visible(scene, instant, x)
        energy, system = linearise(scene, instant, number, x, weight)
    return x, step, f"went on after {settings.steps[number]} steps"


def _pixel(cameras: Cameras, x: Array) -> float:
    """Size of a pixel at the surface [m], middle of the rig."""
    distance = np.linalg.norm(cameras.centres() - x.mean(0), axis=1)
    return float(np.median(distance / cameras.K[:, 0, 0]))
