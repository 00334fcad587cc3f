"""What a fit says about the fabric, in units anybody can check, and what it cannot say."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.gauss_newton import BOUNDS, PARAMETERS, Fit, logarithms
from tasks.cloth.scene import Scene
from tasks.geometry.meshes import edges
from tasks.simulator import Fabric

Z90 = 1.645
EDGES_PER_BENDING_LENGTH = 1.3
GRAVITY = 9.81
UNITS = {"log_membrane": ("kappa_s_over_rho", "m3/kg"), "log_bending": ("kappa_b_over_rho", "m3/kg")}


def estimates(scene: Scene, fit: Fit) -> dict[str, dict[str, Any]]:
    """κ_s/ρ and κ_b/ρ with 90 % intervals; None where the recording or the mesh cannot tell, and the sentence says why."""
    found = {}
    for p, name in enumerate(PARAMETERS):
        key, unit = UNITS[name]
        value = {"log_membrane": fit.fabric.membrane, "log_bending": fit.fabric.bending}[name] / fit.fabric.density
        spread = np.exp(Z90 * np.sqrt(fit.covariance[p, p])) if np.isfinite(fit.covariance[p, p]) else np.inf
        sentence = _doubt(scene, fit, name)
        known = not sentence and np.isfinite(spread)
        found[key] = {
            "value": float(value) if known else None,
            "low": float(value / spread) if known else None,
            "high": float(value * spread) if known else None,
            "unit": unit,
            "sentence": sentence or f"{key} = {value:.3g} {unit}, 90 % interval {value / spread:.3g} to {value * spread:.3g}",
        }
    return found


def bending_length(fabric: Fabric) -> float:
    """(B/(ρ̄ g))^⅓ [m]: how far the cloth stands out under its own weight, B the rigidity of the hinged sheet."""
    return float((fabric.bending_rigidity / (fabric.areal_density * GRAVITY)) ** (1 / 3))


def mean_edge(x: NDArray[np.float64], faces: NDArray[np.int32]) -> float:
    """Mean edge length [m]."""
    e = edges(faces)
    return float(np.linalg.norm(x[e[:, 0]] - x[e[:, 1]], axis=1).mean())


def _doubt(scene: Scene, fit: Fit, name: str) -> str:
    value = logarithms(fit.fabric)[PARAMETERS.index(name)]
    low, high = BOUNDS[name]
    if not fit.replay.complete:
        return f"not estimated: {fit.ending}"
    if min(value - low, high - value) < 1e-6:
        return "at its bound: the recording does not limit it on this side"
    edge = mean_edge(scene.cloth.x_rest, scene.cloth.faces)
    if name == "log_bending" and bending_length(fit.fabric) < EDGES_PER_BENDING_LENGTH * edge:
        return f"insensitive: the bending length {1e3 * bending_length(fit.fabric):.1f} mm is below {EDGES_PER_BENDING_LENGTH} edges of {1e3 * edge:.1f} mm"
    return ""
