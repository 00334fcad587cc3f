"""One instant: photometric + outline + ISO + normal energy, minimised coarse to fine by damped Gauss–Newton.

E(x) = P_photo(x) + P_outline(x) + P_iso(x) + P_normal(x) + ½ Σ_v w_v |x_v − anchor_v|²

At each blur: find what is visible, linearise, solve (H + λI)δ = −∇E, and take δ if E falls (visibility held fixed); λ falls after a
success and rises after a failure (Levenberg–Marquardt, Nocedal & Wright 2006 §10.3). The level ends when the mean step is small
against the blur, when λ finds no descent, or after a set number of steps. Visibility is renewed every few steps taken.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.cameras import Cameras
from tasks.tracking import blocks, isometry, normal_consistency, outline, photometric
from tasks.tracking.pyramid import Level
from tasks.tracking.reference import Reference
from tasks.tracking.settings import Settings
from tasks.tracking.surface import Shape, Surface
from tasks.tracking.visibility import Occluder, buffers, facing_cosines

Array = NDArray[np.float64]

_REFUSALS = 3
_RISE, _FALL = 10.0, 0.2


@dataclass(frozen=True)
class Scene:
    """What stays the same over the sequence. pixel: size of a pixel at the surface [m]."""

    surface: Surface
    cameras: Cameras
    reference: Reference
    settings: Settings
    pixel: float


@dataclass(frozen=True)
class Instant:
    """What belongs to one frame: image levels coarse to fine, the masks' outlines, the shape aimed at, and what stands in the way."""

    levels: tuple[Level, ...]
    outlines: outline.Outlines | None
    shape: Shape
    occluder: Occluder | None


@dataclass(frozen=True)
class View:
    """What is visible from where:
    facing cosines [sample, camera], 0 where hidden or without reference, and the rim where there are masks.
    """

    weight: NDArray[np.float32]
    rim: outline.Rim | None


@dataclass(frozen=True)
class Fit:
    """x [V, 3] m; weight [sample, camera] of the last look; system at x and at the finest blur; mean last step m; how it ended."""

    x: Array
    weight: NDArray[np.float32]
    system: blocks.NormalEquations
    last_step: float
    ending: str


def pixel_size(cameras: Cameras, x: Array) -> float:
    """Size of a pixel at the surface x [V, 3] m, middle of the rig [m]."""
    distance = np.linalg.norm(cameras.centres() - x.mean(0), axis=1)
    return float(np.median(distance / cameras.K[:, 0, 0]))


def fit(scene: Scene, instant: Instant, start: Array) -> Fit:
    """Bring the surface from `start` [V, 3] m to where the images of this instant are explained."""
    x, ends = start, []
    for number in range(len(instant.levels)):
        x, step, end = _descend(scene, instant, number, x)
        ends.append(f"{instant.levels[number].blur:g} px {end}")
    view = look(scene, instant, x)
    _, system = linearise(scene, instant, len(instant.levels) - 1, x, view)
    return Fit(x, view.weight, system, step, ", ".join(ends))


def look(scene: Scene, instant: Instant, x: Array) -> View:
    """What of the surface at x [V, 3] m the cameras see."""
    surface, settings = scene.surface, scene.settings
    small = scene.cameras.scaled(settings.buffer_scale)
    own = buffers(small, x, surface.faces)
    cosine = facing_cosines(
        x, surface, scene.cameras, occluder=instant.occluder, side=scene.reference.side, facing=settings.facing, settings=settings, own=own
    )
    return View(np.abs(cosine) * scene.reference.known[:, None], None if instant.outlines is None else outline.rim(own, small))


def linearise(scene: Scene, instant: Instant, number: int, x: Array, view: View) -> tuple[float, blocks.NormalEquations]:
    """Energy and normal equations at x for level `number`, with visibility held at `view`."""
    surface, settings, shape, level = scene.surface, scene.settings, instant.shape, instant.levels[number]
    e1, *photo = photometric.derivatives(
        x, surface.faces, surface.barycentric, level=level, cameras=scene.cameras, weight=view.weight,
        reference=scene.reference.colour[number], sigma=(settings.sigma_colour, settings.sigma_mask),
        sample_area=surface.mean_face / len(surface.barycentric) / scene.pixel**2,
    )  # fmt: skip
    if view.rim is not None:
        outline.add_derivatives(
            x, surface.faces, view.rim, outlines=instant.outlines, cameras=scene.cameras, sigma=max(settings.sigma_outline, level.blur),
            energy=e1, gradient=photo[0], hessian=photo[1],
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
    enough = settings.settled_px * instant.levels[number].blur * scene.pixel
    λ, refused, taken, step = settings.damping, 0, 0, np.inf
    view = look(scene, instant, x)
    energy, system = linearise(scene, instant, number, x, view)
    for k in range(settings.steps[number]):
        δ, _ = blocks.solve(system, damping=λ)
        δ *= np.minimum(1.0, settings.largest_step / np.maximum(np.linalg.norm(δ, axis=1), 1e-12))[:, None]
        trial, trial_system = linearise(scene, instant, number, x + δ, view)
        if not trial < energy:
            λ, refused = λ * _RISE, refused + 1
            if refused > _REFUSALS:
                return x, step, f"found no descent after {k + 1} steps"
            continue
        x, step = x + δ, float(np.linalg.norm(δ, axis=1).mean())
        λ, refused, taken = max(λ * _FALL, settings.damping), 0, taken + 1
        if step < enough:
            return x, step, f"settled after {k + 1} steps"
        energy, system = trial, trial_system
        if taken % settings.look_again == 0:
            view = look(scene, instant, x)
            energy, system = linearise(scene, instant, number, x, view)
    return x, step, f"went on after {settings.steps[number]} steps"
