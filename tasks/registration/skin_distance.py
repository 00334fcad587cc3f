"""How far points of the body lie from tracked skin, as one number with gradient and curvature.

    E = λ (N/q) Σ_i [ g(d_i) + τ ‖p_i − s_i‖² ],    d_i = n_i·(p_i − s_i),    g(d) = d² ρ²/(ρ² + d²)

p_i: point of the body closest to the tracked vertex s_i, n_i its normal. Point to plane (Chen & Medioni 1992): skin may slide along a body
that is not yet in place; a little of the whole distance (τ) keeps flat regions from drifting. Saturated (Geman & McClure 1987) beyond ρ
= 3 cm: hair and shoes are no skin. The interface is `body/reprojection.Sight`'s, so the body's own objective takes it in place of what
cameras saw.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.distances import closest_points
from tasks.geometry.meshes import vertex_normals

Array = NDArray[np.float64]
Faces = NDArray[np.int32]

STRENGTH = 1e3  # λ [1/m²]
POINTS = 600  # N: the sum means the same for every mesh
SLIDE = 0.05  # τ
SATURATION = 0.03  # ρ [m]
FARTHEST = 0.08  # [m] from the body that tracked skin may be to be matched with it,
ALIKE = 0.7  # and cosine of their normals


@dataclass(frozen=True)
class SkinDistance:
    """skin [q, 3] m, where it was tracked; normal [q, 3] of the body there."""

    skin: Array
    normal: Array

    def energy(self, p: Array) -> float:
        """E for points p [q, 3] m."""
        r, d = self._errors(p)
        g = d**2 * SATURATION**2 / (SATURATION**2 + d**2)
        return float(self._weight * (g + SLIDE * np.sum(r**2, 1)).sum())

    def expand(self, p: Array) -> tuple[float, Array, Array]:
        """E, its gradient [q, 3] 1/m and its curvature [q, 3, 3] 1/m² (of reweighted least squares) at p [q, 3] m."""
        r, d = self._errors(p)
        a = (SATURATION**2 / (SATURATION**2 + d**2)) ** 2
        gradient = a[:, None] * d[:, None] * self.normal + SLIDE * r
        curvature = a[:, None, None] * self.normal[:, :, None] * self.normal[:, None] + SLIDE * np.eye(3)
        return self.energy(p), 2 * self._weight * gradient, 2 * self._weight * curvature

    @property
    def _weight(self) -> float:
        return STRENGTH * POINTS / max(len(self.skin), 1)

    def _errors(self, p: Array) -> tuple[Array, Array]:
        r = p - self.skin
        return r, np.sum(r * self.normal, 1)


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
    normal = np.einsum("qc,qca->qa", found.barycentric, vertex_normals(body, faces)[faces[found.face]])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    ok = (found.distance < FARTHEST) & (np.sum(normal * skin_normal, 1) > ALIKE)
    return Match(skin[ok], found.face[ok], found.barycentric[ok], normal[ok], found.distance[ok])
