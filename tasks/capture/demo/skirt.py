"""A flared skirt in two panels that unrolls into the pattern without stretching.

It is a general cone. Seen from an apex above the waist, the lower body fills a region of the plane; a smooth convex curve around that
region is the directrix, and the cone over it contains the body at every height. Unrolling takes a ray at spherical arc length φ
to the ray at polar angle φ of the pattern (do Carmo 1976, §4-2, example of the cone).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.capture.demo.garments import Garment, Panel, sew
from tasks.capture.demo.hulls import arc_length, hull_curve
from tasks.capture.demo.panels import sample, triangulate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SkirtCut:
    """Height of the waist edge, length and ease in metres; slope = horizontal over vertical run of the side."""

    waist: float
    length: float = 0.40
    slope: float = 0.5
    ease: float = 0.012


def skirt(body: Array, cut: SkirtCut, *, spacing: float, rng: np.random.Generator) -> Garment:
    """The skirt around the points body [P, 3] m (arms left out), standing and facing +z. Its waist edge is the boundary."""
    apex, rays = cone(body, cut)
    φ, waist = arc_length(rays), (apex[1] - cut.waist) / -rays[:, 1]
    half = len(rays) // 2
    panels = []
    for part in (slice(0, half + 1), slice(half, None)):  # front, back; side seams where the directrix faces ±x
        outline, at_waist = _outline(φ[part], waist[part], cut.length, spacing)
        points, faces = triangulate(outline, spacing, rng)
        middle = φ[part].mean()
        ray = np.stack([np.interp(np.arctan2(points[:, 0], -points[:, 1]) + middle, φ, column) for column in rays.T], 1)
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        held = np.zeros(len(points), bool)
        held[at_waist] = True
        panels.append(Panel(points, faces, apex + np.linalg.norm(points, axis=1)[:, None] * ray, held))
    return sew("skirt", panels)


def cone(body: Array, cut: SkirtCut) -> tuple[Array, Array]:
    """Apex [3] m and unit rays [θ, 3] of the smallest smooth convex cone that holds the body below the waist."""
    near = body[np.abs(body[:, 1] - cut.waist) < 0.02]
    centre, radius = (near.min(0) + near.max(0)) / 2, np.ptp(near[:, [0, 2]], axis=0).mean() / 2
    apex = np.array([centre[0], cut.waist + (radius + cut.ease) / cut.slope, centre[2]])
    below = body[(body[:, 1] < cut.waist + 0.01) & (body[:, 1] > cut.waist - cut.length - 0.03)] - apex
    seen = below[:, [0, 2]] / -below[:, 1:2]
    directrix = hull_curve(seen, cut.ease / (apex[1] - cut.waist))
    rays = np.insert(directrix, 1, -1.0, axis=1)
    return apex, rays / np.linalg.norm(rays, axis=1, keepdims=True)


def _outline(φ: Array, waist: Array, length: float, spacing: float) -> tuple[Array, NDArray[np.int64]]:
    """Outline [B, 2] m of one panel hanging from the apex at the origin, and which of its points lie on the waist."""
    middle = φ.mean()
    fan = np.stack([np.sin(φ - middle), -np.cos(φ - middle)], 1)
    hem, top = sample((waist + length)[:, None] * fan, spacing), sample(waist[:, None] * fan, spacing)
    right, left = sample(np.stack([hem[-1], top[-1]]), spacing), sample(np.stack([top[0], hem[0]]), spacing)
    first = len(hem) - 1 + len(right) - 1
    return np.concatenate([hem[:-1], right[:-1], top[::-1][:-1], left[:-1]]), first + np.arange(len(top))
