"""The template as a scanner would give it: the surface of frame 0 on meshes of its own, with smooth noise.

Garments are cut again from the same pattern in larger triangles and placed on the simulated surface through the pattern; the skin is
decimated. So no stage sees the mesh on which the truth was computed. The noise is white noise averaged over neighbours until it is
smooth over a few edges, scaled to a standard deviation of `NOISE` along each axis.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.capture.demo.actor import Actor
from tasks.capture.demo.charts import box_charts, pack
from tasks.capture.demo.garments import Garment, Sampling, locate
from tasks.capture.template import Template
from tasks.geometry.distances import closest_points
from tasks.geometry.meshes import edges, submesh
from tasks.geometry.parts import SKIN

Array = NDArray[np.float64]

NOISE = 0.4e-3  # [m] per axis: 0.7 mm in space
AVERAGING = 6  # rounds over neighbours
SKIN_FACES = 6000


@dataclass(frozen=True)
class Scan:
    """The template and, for its vertices part by part (body first), the place on the true surfaces that they were taken from."""

    template: Template
    places: dict[str, Sampling]


def scan(
    actor: Actor, fine: Mapping[str, Garment], coarse: Mapping[str, Garment], worn: Mapping[str, Array], rng: np.random.Generator
) -> Scan:
    """Template of frame 0. fine, coarse: the garments as simulated and as scanned; worn: simulated vertices [V, 3] m of frame 0."""
    x, faces, place = _skin(actor)
    parts = [(SKIN, x, faces, *box_charts(x, faces))]
    places = {SKIN: place}
    for name, garment in coarse.items():
        places[name] = locate(garment, fine[name])
        parts.append((name, places[name].of(worn[name]), garment.faces, garment.uv_vertices, garment.uv_faces))
    return Scan(_join(parts, rng), places)


def _skin(actor: Actor) -> tuple[Array, NDArray[np.int32], Sampling]:
    import igl

    model, posed = actor.model, actor.posed.vertices[0]
    whole, kept = submesh(model.faces, model.skin)
    x, faces, *_ = igl.qslim(np.asfortranarray(posed[kept]), np.asfortranarray(whole.astype(np.int64)), SKIN_FACES)
    near = closest_points(np.ascontiguousarray(x), posed[kept], whole)
    return near.point, np.ascontiguousarray(faces, np.int32), Sampling(kept[whole[near.face]], near.barycentric)


def _join(parts: list[tuple], rng: np.random.Generator) -> Template:
    """Parts (name, vertices, faces, uv_vertices, uv_faces) as one mesh with noise and one atlas."""
    vertex, uv = np.cumsum([0, *(len(p[1]) for p in parts)]), np.cumsum([0, *(len(p[3]) for p in parts)])
    faces = np.concatenate([p[2] + v for p, v in zip(parts, vertex)]).astype(np.int32)
    uv_faces = np.concatenate([p[4] + u for p, u in zip(parts, uv)]).astype(np.int32)
    x = np.concatenate([p[1] for p in parts])
    part = np.repeat([p[0] for p in parts], [len(p[2]) for p in parts])
    return Template(x + smooth_noise(faces, len(x), rng), faces, pack(np.concatenate([p[3] for p in parts]), uv_faces), uv_faces, part)


def smooth_noise(faces: NDArray[np.int32], vertex_count: int, rng: np.random.Generator) -> Array:
    """Noise [V, 3] m that varies over a few edges."""
    a, b = edges(faces).T
    degree = np.bincount(np.r_[a, b], minlength=vertex_count)[:, None] + 1
    noise = rng.standard_normal((vertex_count, 3))
    for _ in range(AVERAGING):
        total = noise.copy()
        np.add.at(total, a, noise[b])
        np.add.at(total, b, noise[a])
        noise = total / degree
    return noise / noise.std() * NOISE
