"""How far projected points lie from detected ones, as one number with gradient and curvature: equation 1 of the supplement, made smooth.

    e = s ‖uv − û v‖₂ [working px],   g = e² ρ²/(ρ² + e²),   d(e) = √(ε² + g) − ε,   E = Σ_q λ_q (N/C) Σ_c score_cq d(e_cq)

d is the norm of equation 1, rounded off below ε = 1 px (a norm has no curvature at zero) and saturated beyond ρ = 100 px (Geman & McClure
1987, with ρ as in MultiviewSMPLify-X) so that wrong detections do not pull. A working pixel is 1/1000 of the image's long side, and the sum
over C cameras is scaled to the N = 160 of the paper: so the λ of the supplement mean the same for every rig and resolution.
Limit: the curvature is that of iteratively reweighted least squares, positive semidefinite, not the exact Hessian.
"""

from dataclasses import dataclass

import numpy as np

from tasks.body.model import Array
from tasks.geometry.cameras import Cameras, undistort_points

WORKING_SIZE = 1000.0  # [px] long side of an image in working pixels
ROUNDING = 1.0  # ε [working px]
SATURATION = 100.0  # ρ [working px]
PAPER_CAMERAS = 160.0  # N
NEAR = 0.05  # [m] depth below which a point is not compared


@dataclass(frozen=True)
class Sight:
    """What the cameras saw in one frame: uv [camera,q,2] px free of distortion, trust [camera,q] = λ_q (N/C) score."""

    cameras: Cameras
    uv: Array
    trust: Array

    @staticmethod
    def of(cameras: Cameras, uv: Array, score: Array, weight: Array) -> "Sight":
        """From detected pixels uv [camera,q,2] (NaN: not detected), scores [camera,q] and the λ [q] of each keypoint."""
        seen = np.isfinite(uv).all(axis=-1) & (score > 0)
        clean = undistort_points(cameras, np.where(seen[..., None], uv, cameras.K[:, None, :2, 2]))
        trust = np.where(seen, score, 0.0) * weight * PAPER_CAMERAS / len(cameras)
        return Sight(cameras, clean, trust)

    def energy(self, p: Array) -> float:
        """E for points p [q,3] m."""
        e, _, near = self._errors(p)
        return float((self.trust * near * _distance(e)).sum())

    def expand(self, p: Array) -> tuple[float, Array, Array]:
        """E, its gradient [q,3] 1/m and its curvature [q,3,3] 1/m² at p [q,3] m."""
        e, r, near = self._errors(p)
        a = self.trust * near * _slope_over_error(e)
        J = self._projection_jacobian(p)
        Ja = J * a[..., None, None]
        return float((self.trust * near * _distance(e)).sum()), np.einsum("cqxi,cqx->qi", Ja, r), np.einsum("cqxi,cqxj->qij", Ja, J)

    def _errors(self, p: Array) -> tuple[Array, Array, Array]:
        """e [camera,q] and residuals [camera,q,2] in working px, and whether the point lies before the camera [camera,q]."""
        x = self._in_camera(p)
        z = np.maximum(x[..., 2:], NEAR)
        at = np.einsum("cxy,cqy->cqx", self.cameras.K[:, :2, :2], x[..., :2] / z) + self.cameras.K[:, None, :2, 2]
        r = (at - self.uv) * self._scale()
        return np.linalg.norm(r, axis=-1), r, x[..., 2] > NEAR

    def _projection_jacobian(self, p: Array) -> Array:
        x, R, K = self._in_camera(p), self.cameras.R, self.cameras.K[:, :2, :2]
        z = np.maximum(x[..., 2], NEAR)[..., None, None]
        J = (R[:, None, :2] - (x[..., :2] / z[..., 0])[..., None] * R[:, None, 2:]) / z
        return np.einsum("cxy,cqyi->cqxi", K, J) * self._scale()[..., None]

    def _in_camera(self, p: Array) -> Array:
        return np.einsum("cxy,qy->cqx", self.cameras.R, p) + self.cameras.t[:, None]

    def _scale(self) -> Array:
        return (WORKING_SIZE / self.cameras.size.max(axis=1))[:, None, None]


def _distance(e: Array) -> Array:
    return np.sqrt(ROUNDING**2 + _saturated(e)) - ROUNDING


def _slope_over_error(e: Array) -> Array:
    return (SATURATION**2 / (SATURATION**2 + e**2)) ** 2 / np.sqrt(ROUNDING**2 + _saturated(e))


def _saturated(e: Array) -> Array:
    return e**2 * SATURATION**2 / (SATURATION**2 + e**2)
