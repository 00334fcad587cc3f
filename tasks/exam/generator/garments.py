"""Garments in two meshes of one pattern: the fine one that is simulated, and the coarse one on which a tracker reports it.

Every coarse vertex is a point of the smooth surface through the fine vertices, found by its place in the pattern.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.exam.generator.pattern_mesh import FlatMesh, Pattern, flat_mesh, locate
from tasks.geometry.meshes import edges, vertex_normals

Array = NDArray[np.float64]
Faces = NDArray[np.int32]


@dataclass(frozen=True)
class Sheet:
    """rest [V, 3] m worn rest shape, faces [F, 3], flat [F, 3, 2] m corners in the pattern (weft, warp), t [V] from top (0) to hem (1).

    pinned [B]: vertices carried along by the body; seam [E, 2]: edges that are sewn.
    """

    rest: Array
    faces: Faces
    flat: Array
    t: Array
    pinned: Faces
    seam: Faces

    @property
    def areas(self) -> Array:
        """Areas [F] m² of the triangles in the pattern."""
        return np.abs(np.linalg.det(self.flat[:, 1:] - self.flat[:, :1])) / 2


@dataclass(frozen=True)
class Garment:
    """kind; fine and coarse sheets; corners [C, 3] and weights [C, 3]: coarse vertices on the fine one; uv [C, 2] m of an unsewn pattern."""

    kind: str
    fine: Sheet
    coarse: Sheet
    corners: Faces
    weights: Array
    uv: Array | None

    def resampled(self, field: Array) -> Array:
        """A field [V, K] of the fine mesh on the coarse one [C, K], linear within triangles."""
        return np.einsum("ckd,ck->cd", field[self.corners], self.weights)

    def tracked(self, x: Array) -> Array:
        """Positions [C, 3] of the coarse vertices on the smooth surface through the fine ones, x [V, 3]: with p = Σ bᵢ xᵢ in the flat
        triangle,

            y = p − ½ Σ bᵢ nᵢ (nᵢ·(p − xᵢ))

        Where the surface is quadratic flat triangles lie as far inside as tangent planes lie outside, so that their mean is exact. Without
        it every vertex would lie inside by up to |edge|² curvature/8, each by another share: wrinkles that no cloth has, for which only
        bending could answer.
        """
        n = vertex_normals(x, self.fine.faces)[self.corners]
        p = self.resampled(x)
        height = np.einsum("ckd,ckd->ck", p[:, None] - x[self.corners], n)
        return p - 0.5 * np.einsum("ck,ck,ckd->cd", self.weights, height, n)


@dataclass(frozen=True)
class Cut:
    """How a garment is cut: its pattern, where its pattern goes in space, and which of its places (s, t) are pinned."""

    kind: str
    pattern: Pattern
    lift: str
    pinned: str


def cut(kind: str, rng: np.random.Generator) -> Cut:
    """A garment of one of the kinds skirt, curtain, cape, sleeve with dimensions drawn at random."""
    if kind == "curtain":
        pinned = rng.choice(["top", "corners"], p=[0.75, 0.25])
        return Cut(kind, Pattern(rng.uniform(0.38, 0.55), rng.uniform(0.45, 0.65)), "plane", str(pinned))
    if kind == "skirt":
        waist, slope = rng.uniform(0.115, 0.135), rng.uniform(0.3, 0.5)  # radius [m], radius gained per length
        return Cut(kind, _cone(waist, rng.uniform(0.32, 0.42), slope), "cone", "top")
    if kind == "cape":
        neck, slope = rng.uniform(0.09, 0.1), rng.uniform(0.5, 0.6)
        return Cut(kind, _cone(neck, rng.uniform(0.32, 0.4), slope), "cone", "top")
    if kind == "sleeve":
        radius = rng.uniform(0.075, 0.095)
        return Cut(kind, Pattern(2 * np.pi * radius, rng.uniform(0.42, 0.52), sewn=True), "tube", "top")
    raise ValueError(f"there is no garment {kind!r}")


def _cone(radius: float, length: float, slope: float) -> Pattern:
    """Pattern of a cone frustum whose radius grows by `slope` per slant length."""
    return Pattern(2 * np.pi * radius, length, inner=radius / slope, sewn=True)


def tailor(form: Cut, coarse_count: int, fineness: float, rng: np.random.Generator) -> Garment:
    """A garment with about `coarse_count` vertices on the coarse mesh and `fineness` times that on the fine one."""
    coarse, fine = (flat_mesh(form.pattern, round(n), rng) for n in (coarse_count, fineness * coarse_count))
    face, weights = locate(form.pattern, fine, *_points(coarse))
    uv = None if form.pattern.sewn else form.pattern.place(*_points(coarse)) * [1, -1]
    fine_sheet = _sheet(form, fine)
    return Garment(form.kind, fine_sheet, _sheet(form, coarse), fine_sheet.faces[face], weights, uv)


def _points(mesh: FlatMesh) -> tuple[Array, Array]:
    """s, t of each vertex."""
    first = np.unique(mesh.vertex, return_index=True)[1]
    return mesh.s[first], mesh.t[first]


def _sheet(form: Cut, mesh: FlatMesh) -> Sheet:
    s, t = _points(mesh)
    faces = mesh.vertex[mesh.faces]
    flat = form.pattern.place(mesh.s, mesh.t)[mesh.faces]
    rest = lifted(form, s, t)
    on_top = t < 1e-9
    if form.pinned == "corners":
        on_top &= (s < 0.12) | (s > 0.88)
    border = np.flatnonzero(mesh.s == 0.0)
    on_seam = np.zeros(len(t), bool)
    on_seam[mesh.vertex[border]] = form.pattern.sewn
    e = edges(faces)
    return Sheet(rest, faces, flat, t, np.flatnonzero(on_top).astype(np.int32), e[on_seam[e].all(1)])


def lifted(form: Cut, s: Array, t: Array) -> Array:
    """Rest places [V, 3] m of pattern places s, t [V]; the top edge at height 0 (of the sleeve: its axis along +x from x = 0)."""
    p = form.pattern
    if form.lift == "plane":
        return np.stack([(s - 0.5) * p.width, -t * p.height, np.zeros_like(s)], -1)
    angle = 2 * np.pi * s
    if form.lift == "tube":
        R = p.width / (2 * np.pi)
        return np.stack([t * p.height, -R * np.cos(angle), -R * np.sin(angle)], -1)
    slope = p.opening / (2 * np.pi)
    R = (p.inner + t * p.height) * slope
    return np.stack([R * np.cos(angle), -t * p.height * np.sqrt(1 - slope**2), -R * np.sin(angle)], -1)
