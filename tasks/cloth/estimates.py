"""What a fit says about the fabric, in units anybody can check, and what it cannot say.

Without air every term of the base model is proportional to one of (ρ, κ_s, κ_b) or to nothing: c·(ρ, κ_s, κ_b) moves exactly as (ρ, κ_s,
κ_b) does, for every c > 0. That gauge direction is not estimated: ratios to the density are, and a weight turns them into stiffnesses.

    κ_s/ρ, κ_b/ρ  [m³/kg],      E t/ρ̄ [m²/s²],  B/ρ̄ [m⁴/s²] with the areal density ρ̄

Where effects were added to the base model, their strengths stand beside these, under the effects' columns (`air_normal_drag`,
`air_wind.w_x`).
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.base_parameters import BOUNDS, PARAMETERS, logarithms
from tasks.cloth.gauss_newton import UNKNOWN, Fit
from tasks.cloth.joint_refit import CompletedFit
from tasks.cloth.scene import Scene
from tasks.effects.effect import Effect, Strength
from tasks.geometry.faults import Fault, refuse
from tasks.geometry.meshes import edges
from tasks.simulator import Fabric

EDGES_PER_BENDING_LENGTH = 1.3
GRAVITY = 9.81
LEAST_KNOWN = np.log(10)  # a 90 % interval wider than this factor both ways is no estimate
UNITS = {"log_membrane": ("kappa_s_over_rho", "m3/kg"), "log_bending": ("kappa_b_over_rho", "m3/kg")}
PLAIN_UNITS = {"log_membrane": ("stretch_over_areal_density", "m2/s2"), "log_bending": ("bending_over_areal_density", "m4/s2")}
BASE = {key for key, _ in (*UNITS.values(), *PLAIN_UNITS.values())} | {"density", "areal_density"}
GAUGE = (
    "motion is the same for (c ρ, c κ_s, c κ_b) with any c > 0: this direction is not estimated, only κ_s/ρ and κ_b/ρ are. "
    "A weight of the garment (mass_kg) fixes it."
)


def estimates(scene: Scene, fit: Fit, *, weighed: bool = False) -> dict[str, dict[str, Any]]:
    """κ_s/ρ and κ_b/ρ with 90 % intervals, the same in plain SI units, and the density where the garment was weighed.

    None where the recording or the mesh cannot tell, and the sentence says why.
    """
    found = {}
    for p, name in enumerate(PARAMETERS):
        doubt = _doubt(scene, fit, p)
        for (key, unit), value in ((UNITS[name], _ratio(fit.fabric, name)), (PLAIN_UNITS[name], _plain(fit.fabric, name))):
            found[key] = _estimate(key, value, unit, fit.normal.half_width[p], doubt)
    return found | densities(fit.fabric, weighed=weighed) | _strengths(fit)


def added_effects(
    said: Mapping[str, Mapping[str, Any]], known: Mapping[str, Effect]
) -> tuple[tuple[Effect, ...], dict[str, NDArray[np.float64]]]:
    """The effects, among the `known` ones, that estimates speak of, and name -> their strengths [K]. Raises BadInput for one that is not among them."""
    effects = tuple(e for e in known.values() if all(column in said for column in e.columns))
    strange = said.keys() - BASE - {column for e in effects for column in e.columns}
    remedy = "Name the folder it came from as effects_folder here too."
    refuse(Fault("cloth", f"its model has {column!r}, of no effect that is known", remedy) for column in sorted(strange))
    return effects, {e.name: np.array([said[column]["value"] for column in e.columns]) for e in effects}


def densities(fabric: Fabric, *, weighed: bool) -> dict[str, dict[str, Any]]:
    """ρ [kg/m³] and ρ̄ [kg/m²], known only by weighing."""
    found = {}
    for key, value, unit in (("density", fabric.density, "kg/m3"), ("areal_density", fabric.areal_density, "kg/m2")):
        if weighed:
            said = {
                "value": float(value),
                "low": None,
                "high": None,
                "sentence": f"{key} = {value:.3g} {unit}, from the weight of the garment",
            }
        else:
            said = {"value": None, "low": None, "high": None, "sentence": f"not known: {GAUGE}"}
        found[key] = {**said, "unit": unit}
    return found


def bending_length(fabric: Fabric) -> float:
    """(B/(ρ̄ g))^⅓ [m]: how far the cloth stands out under its own weight, B the rigidity of the hinged sheet."""
    return float((fabric.bending_rigidity / (fabric.areal_density * GRAVITY)) ** (1 / 3))


def mean_edge(x: NDArray[np.float64], faces: NDArray[np.int32]) -> float:
    """Mean edge length [m]."""
    e = edges(faces)
    return float(np.linalg.norm(x[e[:, 0]] - x[e[:, 1]], axis=1).mean())


def insensitive(scene: Scene, fabric: Fabric) -> str:
    """Why the mesh cannot show this fabric's bending; empty where it can."""
    edge, length = mean_edge(scene.cloth.x_rest, scene.cloth.faces), bending_length(fabric)
    if length >= EDGES_PER_BENDING_LENGTH * edge:
        return ""
    return f"insensitive: the bending length {1e3 * length:.1f} mm is below {EDGES_PER_BENDING_LENGTH} edges of {1e3 * edge:.1f} mm"


def at_bound(fabric: Fabric, name: str) -> str:
    """Which bound a parameter lies at; empty where it lies between."""
    value, (low, high) = logarithms(fabric)[PARAMETERS.index(name)], BOUNDS[name]
    if min(value - low, high - value) > 1e-6:
        return ""
    return f"at its {'lower' if value - low < high - value else 'upper'} bound: the recording does not limit it on this side"


def _ratio(fabric: Fabric, name: str) -> float:
    return {"log_membrane": fabric.membrane, "log_bending": fabric.bending}[name] / fabric.density


def _plain(fabric: Fabric, name: str) -> float:
    return {"log_membrane": fabric.stretch_stiffness, "log_bending": fabric.bending_rigidity}[name] / fabric.areal_density


def _estimate(key: str, value: float, unit: str, width: float, doubt: str) -> dict[str, Any]:
    if doubt:
        return {"value": None, "low": None, "high": None, "unit": unit, "sentence": doubt}
    spread = float(np.exp(width))
    low, high = value / spread, value * spread
    sentence = f"{key} = {value:.3g} {unit}, 90 % interval {low:.3g} to {high:.3g}"
    return {"value": value, "low": low, "high": high, "unit": unit, "sentence": sentence}


def _strengths(fit: Fit) -> dict[str, dict[str, Any]]:
    """Every effect's strengths; none where the model is the base alone."""
    effects = fit.model.effects if isinstance(fit, CompletedFit) else ()
    columns = [(e, k) for e in effects for k in range(len(e.strengths))]
    return {
        e.columns[k]: _strength(e.columns[k], e.strengths[k], float(fit.model.strength(e)[k]), fit.normal.half_width[p], fit.ending)
        for p, (e, k) in enumerate(columns, len(PARAMETERS))
    }


def _strength(column: str, s: Strength, value: float, width: float, ending: str) -> dict[str, Any]:
    """width: half of the 90 % interval, in typical strengths."""
    if not np.isfinite(width):
        return {"value": value, "low": None, "high": None, "unit": s.unit, "sentence": f"not estimated: {ending}"}
    spread = float(width) * abs(s.typical)
    low, high = value - spread, value + spread
    sentence = f"{column} = {value:.3g} {s.unit}, 90 % interval {low:.3g} to {high:.3g}"
    if min(value - s.low, s.high - value) < 1e-6 * abs(s.typical):
        sentence += f"; at the end of its plausible range, {s.low:g} to {s.high:g}"
    return {"value": value, "low": low, "high": high, "unit": s.unit, "sentence": sentence}


def _doubt(scene: Scene, fit: Fit, p: int) -> str:
    """Why parameter p is not estimated; empty where it is."""
    name = PARAMETERS[p]
    if not np.isfinite(fit.normal.A).all():
        return f"not estimated: {fit.ending}"
    if np.isnan(fit.normal.common).any():
        return f"not estimated: {UNKNOWN}"
    if bound := fit.at_ends.get(name) or at_bound(fit.fabric, name):
        return bound
    if name == "log_bending" and (unresolved := insensitive(scene, fit.fabric)):
        return unresolved
    if len(fit.normal.g) < 2:
        return "not estimated: from one stretch of frames nobody can tell how far it may be off; give twice as many frames"
    width = fit.normal.half_width[p]
    if not fit.normal.A.sum(0)[p, p] > 0 or not width < LEAST_KNOWN:
        return "untouched by the data: the recording hardly moves with this parameter"
    return ""
