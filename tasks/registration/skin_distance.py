"""How far points of the body lie from where they were tracked, as one number with gradient and curvature.

    E = Σ_i λ_i g(e_i),    e_i² = d_i² + τ ‖p_i − s_i‖²,    d_i = n_i·(p_i − s_i),    g(e) = e² ρ_i²/(ρ_i² + e²)

p_i: point of the body that the tracked s_i shows, n_i its normal. Point to plane (Chen & Medioni 1992): skin may slide along a body that is
not yet in place, and cloth along skin; a little of the whole distance (τ) keeps flat regions from drifting. Saturated (Geman & McClure 1987)
beyond ρ_i: hair and shoes are no skin, and cloth that has left the skin says nothing. λ_i = λ N/q for q points of a kind, so that a kind
means the same on every mesh. The interface is `body/reprojection.Sight`'s: the body's own objective takes it in place of what cameras saw.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.distances import closest_points
from tasks.geometry.meshes import vertex_normals

Array = NDArray[np.float64]
Faces = NDArray[np.int32]

STRENGTH = 1e3  # λ [1/m²]
POINTS = 600  # N
USED = 500  # of the points of a kind
SLIDE = 0.05  # τ
SATURATION = 0.03  # ρ of skin [m]
FARTHEST = 0.08  # [m] from the body that tracked skin may be to be matched with it,
ALIKE = 0.7  # and cosine of their normals


@dataclass(frozen=True)
class SkinDistance:
    """Of points of one kind. target [q, 3] m, where they were tracked; normal [q, 3] of the body there; saturation: ρ [m]."""

    target: Array
    normal: Array
    saturation: float = SATURATION

    def energy(self, p: Array) -> float:
        """E for points p [q, 3] m."""
        _, _, e2 = self._errors(p)
        return float(self._weight * (e2 * self.saturation**2 / (self.saturation**2 + e2)).sum())

    def expand(self, p: Array) -> tuple[float, Array, Array]:
        """E, its gradient [q, 3] 1/m and its curvature [q, 3, 3] 1/m² (of reweighted least squares) at p [q, 3] m."""
        r, d, e2 = self._errors(p)
        a = 2 * self._weight * (self.saturation**2 / (self.saturation**2 + e2)) ** 2
        gradient = a[:, None] * (d[:, None] * self.normal + SLIDE * r)
        curvature = a[:, None, None] * (self.normal[:, :, None] * self.normal[:, None] + SLIDE * np.eye(3))
        return self.energy(p), gradient, curvature

    @property
    def _weight(self) -> float:
        return STRENGTH * POINTS / max(len(self.target), 1)

    def _errors(self, p: Array) -> tuple[Array, Array, Array]:
        r = p - self.target
        d = np.sum(r * self.normal, 1)
        return r, d, d**2 + SLIDE * np.sum(r**2, 1)


@dataclass(frozen=True)
class Together:
    """Points of several kinds, one kind after the other."""

    kinds: tuple[SkinDistance, ...]

    def energy(self, p: Array) -> float:
        """E for points p [q, 3] m."""
        return sum(kind.energy(own) for kind, own in self._each(p))

    def expand(self, p: Array) -> tuple[float, Array, Array]:
        """E, its gradient [q, 3] 1/m and its curvature [q, 3, 3] 1/m² at p [q, 3] m."""
        energy, gradient, curvature = zip(*(kind.expand(own) for kind, own in self._each(p)), strict=True)
        return sum(energy), np.concatenate(gradient), np.concatenate(curvature)

    def _each(self, p: Array) -> list[tuple[SkinDistance, Array]]:
        ends = np.cumsum([len(kind.target) for kind in self.kinds])[:-1]
        return list(zip(self.kinds, np.split(p, ends), strict=True))


@dataclass(frozen=True)
class Match:
    """Tracked skin [q, 3] m and the points of the body that it lies on: face [q], barycentric [q, 3], normal [q, 3], distance [q] m."""

    skin: Array
    face: NDArray[np.int64]
    barycentric: Array
    normal: Array
    distance: Array


def matched(skin: Array, skin_normal: Array, body: Array, faces: Faces) -> Match:
    """Tracked skin [n, 3] m with normals [n, 3] on the body [V, 3] m: what is near and faces the same way."""
    found = closest_points(skin, body, faces)
    normal = normals_at(faces[found.face], found.barycentric, body, faces)
    ok = (found.distance < FARTHEST) & (np.sum(normal * skin_normal, 1) > ALIKE)
    return Match(skin[ok], found.face[ok], found.barycentric[ok], normal[ok], found.distance[ok])


def normals_at(corners: Faces, barycentric: Array, body: Array, faces: Faces) -> Array:
    """Unit normals [q, 3] of the body [V, 3] m at points of its surface, corners and barycentric [q, 3]."""
    normal = np.einsum("qc,qca->qa", barycentric, vertex_normals(body, faces)[corners])
    return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)


def evenly(points: NDArray[np.int64]) -> NDArray[np.int64]:
    """At most `USED` of them, evenly through their order."""
    return points[np.linspace(0, len(points) - 1, min(USED, len(points))).round().astype(int)]
