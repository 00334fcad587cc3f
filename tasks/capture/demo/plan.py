"""Everything about a demo recording that follows from its seed: actor, garments, fabrics, cameras, paint. Nothing here is slow or on disk.

Each ingredient draws from a stream of its own (seed and purpose), so that changing one does not change the others.
"""

from dataclasses import dataclass
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from tasks.body.model import BodyModel
from tasks.body.wholebody import keypoints133
from tasks.capture.demo import textures
from tasks.capture.demo.actor import Actor, cast
from tasks.capture.demo.complexion import complexion
from tasks.capture.demo.dressing import Fitting, Unmodelled, cut, fit
from tasks.capture.demo.fabrics import draw_fabrics
from tasks.capture.demo.garments import Garment
from tasks.capture.demo.pictures import draw_gains
from tasks.capture.demo.rendering import Surface
from tasks.capture.demo.rig import ring_cameras
from tasks.geometry.cameras import Cameras

Array = NDArray[np.float64]

GARMENTS = {"top": textures.TOP, "skirt": textures.SKIRT}
FINE, COARSE = 0.0235, 0.033  # [m] edges of the simulated and of the scanned garments: twice as many vertices
TEXTURE_WIDTH = 2048
FACE = slice(23 + 17, 23 + 68)  # of the 133 keypoints: the 51 landmarks without the contour


@dataclass(frozen=True)
class Request:
    """What the caller asks for: numbers of cameras and frames, picture size [px], samples per pixel, seed, vigour of the motion."""

    cameras: int = 8
    frames: int = 30
    size: int = 512
    spp: int = 16
    seed: int = 2026
    energy: float = 1.2
    fps: float = 25.0
    portrait: bool = False


@dataclass(frozen=True)
class Plan:
    """actor; fittings (simulated garments), scanned (the same cut coarser); cameras, gains [camera, 3]; surfaces, body first."""

    request: Request
    actor: Actor
    fittings: dict[str, Fitting]
    scanned: dict[str, Garment]
    cameras: Cameras
    gains: Array
    surfaces: tuple[Surface, ...]

    def surface_vertices(self, worn: dict[str, Array], frame: int) -> list[Array]:
        """Vertices of the surfaces at a frame, garments split along their seams; worn: simulated vertices [T, V, 3] m."""
        return [self.actor.posed.vertices[frame], *(worn[name][frame][corner_vertices(f.garment)] for name, f in self.fittings.items())]


def make_plan(request: Request, model: BodyModel, unmodelled: Unmodelled | None = None) -> Plan:
    """The plan of a recording with this body model; unmodelled: what moves the garments beside the base model, air where nothing is given."""
    actor = cast(model, frames=request.frames, fps=request.fps, energy=request.energy, rng=stream(request.seed, "actor"))
    fabrics = draw_fabrics(tuple(GARMENTS), stream(request.seed, "fabrics"))
    fittings = {n: fit(n, actor, fabrics[n], spacing=FINE, rng=stream(request.seed, f"{n} fine"), unmodelled=unmodelled) for n in GARMENTS}
    scanned = {n: cut(n, actor, spacing=COARSE, rng=stream(request.seed, f"{n} coarse")) for n in GARMENTS}
    centre = np.array([0.0, actor.posed.vertices[0][:, 1].max() / 2, 0.0])
    cameras = ring_cameras(
        request.cameras,
        request.size,
        centre,
        rng=stream(request.seed, "cameras"),
        portrait=request.cameras // 2 if request.portrait else None,
    )
    gains = draw_gains(request.cameras, stream(request.seed, "gains"))
    surfaces = (_body_surface(actor, request.seed), *(_garment_surface(f.garment, request.seed) for f in fittings.values()))
    return Plan(request, actor, fittings, scanned, cameras, gains, surfaces)


def stream(seed: int, purpose: str) -> np.random.Generator:
    """A generator of random numbers for one purpose."""
    return np.random.default_rng([seed, crc32(purpose.encode())])


def corner_vertices(garment: Garment) -> NDArray[np.int32]:
    """The vertex [U] at which each point of the pattern is sewn in."""
    index = np.empty(len(garment.uv_vertices), np.int32)
    index[garment.uv_faces.ravel()] = garment.faces.ravel()
    return index


def _body_surface(actor: Actor, seed: int) -> Surface:
    face = keypoints133(actor.model, actor.rest.vertices, actor.rest.joints)[FACE]
    colours = complexion(actor.rest.vertices, actor.rest.joints, actor.model.weights, face, stream(seed, "complexion"))
    return Surface("body", actor.model.faces, colours=colours)


def _garment_surface(garment: Garment, seed: int) -> Surface:
    extent = garment.uv_vertices.max(0)
    texture = textures.woven(extent, GARMENTS[garment.name], width=TEXTURE_WIDTH, rng=stream(seed, f"{garment.name} texture"))
    return Surface(garment.name, garment.uv_faces, uv=garment.uv_vertices / extent, texture=texture)
