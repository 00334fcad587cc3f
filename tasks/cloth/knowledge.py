"""What can be known of a fit beyond its interval: the gauge, the profile of the loss, another interval, and what the choices change.

* gauge: the loss along c·(ρ, κ_s, κ_b), simulated; flat where the base model is all there is.
* profile: the loss at other values of one parameter, the other one following along the valley; Δ is in units of the loss at the optimum.
* bootstrap: blocks of frames drawn anew, one Gauss–Newton step each from the optimum (Kline & Santos 2012: no simulation is run again);
  left out where there is one block, which is drawn every time.
* a choice (half the time step, another driver of the boundary): one more Gauss–Newton step from the optimum on the altered scene, less the
  one on the scene itself, of the same objective at the same fabric: nothing changed changes nothing. What the fit's own normal equations
  say is no substitute: they may be of other windows, and their step may have been taken. Start and noise are those of the fit. Numerical
  damping is absorbed by stiffness, so what the half step changes is no interval of any other kind.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.base_parameters import PARAMETERS, moved
from tasks.cloth.estimates import GAUGE, LEAST_KNOWN
from tasks.cloth.gauss_newton import Fit, Normal, Objective, WholeReplay
from tasks.cloth.scene import Scene
from tasks.simulator import Fabric

Array = NDArray[np.float64]

NAMES = dict(zip(PARAMETERS, ("kappa_s_over_rho", "kappa_b_over_rho")))
DRAWS = 500
FACTORS = (0.5, 2.0)
WHOLE = WholeReplay()
OFFSETS = (-2.0, -1.0, 1.0, 2.0)  # standard deviations


def knowledge(
    scene: Scene, fit: Fit, *, objective: Objective = WHOLE, otherwise: Array | None = None, profiles: bool = False
) -> dict[str, Any]:
    """Everything above as JSON, of what `objective` found; `otherwise` [T, B, 3] m: the boundary driven the other way.

    Only the gauge where the fit failed, or has no interval because what mesh and step do is not known.
    """
    if not np.isfinite(fit.covariance).all():
        return {"gauge": {"sentence": GAUGE}}
    scene = replace(scene, noise_m=fit.noise_share * scene.noise_m)
    found = {
        "gauge": gauge(scene, fit.fabric, objective) if profiles else {"sentence": GAUGE},
        **({"bootstrap": intervals(fit.fabric, bootstrap(fit.normal))} if len(fit.normal.g) > 1 else {}),
        **choices(scene, fit, objective, otherwise),
    }
    if profiles:
        found["profile"] = {NAMES[name]: profile(scene, fit, p, objective) for p, name in enumerate(PARAMETERS)}
    return found


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def gauge(scene: Scene, fabric: Fabric, objective: Objective = WHOLE, factors: Sequence[float] = FACTORS) -> dict[str, Any]:
    """Losses at c·(ρ, κ_s, κ_b), and the sentence."""
    along = (1.0, *factors)
    scaled = [replace(fabric, density=c * fabric.density, membrane=c * fabric.membrane, bending=c * fabric.bending) for c in along]
    rows = [{"factor": c, "loss": _finite(found)} for c, found in zip(along, objective.losses(scene, scaled), strict=True)]
    return {"sentence": GAUGE, "profile": rows}


def profile(scene: Scene, fit: Fit, p: int, objective: Objective = WHOLE, offsets: Sequence[float] = OFFSETS) -> list[dict[str, Any]]:
    """Loss at values of parameter p that lie `offsets` standard deviations from the optimum, the other parameter at its conditional optimum."""
    C = fit.covariance
    along = C[:, p] / C[p, p]  # the valley: 1 along p, what the other one does with it
    fabrics = {0.0: fit.fabric} | {offset: moved(fit.fabric, offset * np.sqrt(C[p, p]) * along)[0] for offset in offsets if offset}
    losses = dict(zip(fabrics, objective.losses(scene, list(fabrics.values())), strict=True))
    return [
        {
            "value": (fabrics[offset].membrane, fabrics[offset].bending)[p] / fit.fabric.density,
            "deviations": offset,
            "rise": _finite(losses[offset] / losses[0.0] - 1),
        }
        for offset in sorted(fabrics)
    ]


def bootstrap(normal: Normal, *, draws: int = DRAWS, seed: int = 0) -> Array:
    """Steps [draws, P] to the optima of recordings put together from blocks drawn anew, relative to the optimum of this one."""
    rng, B = np.random.default_rng(seed), len(normal.g)
    picked = rng.integers(B, size=(draws, B))
    steps = np.stack([Normal(normal.g[rows], normal.A[rows]).step for rows in picked])
    return steps - normal.step


def intervals(fabric: Fabric, steps: Array) -> dict[str, Any]:
    """90 % intervals of the ratios from steps [draws, P] of their logarithms; None for an end that a linear step cannot tell."""
    found = {}
    for p, name in enumerate(PARAMETERS):
        value = (fabric.membrane, fabric.bending)[p] / fabric.density
        low, high = (value * f if (f := _factor(step)) else None for step in np.quantile(steps[:, p], (0.05, 0.95)))
        found[NAMES[name]] = {"low": low, "high": high, "unit": "m3/kg"}
    return found


def _factor(step: float) -> float | None:
    """What a step of the logarithm multiplies by, as far as it may be told."""
    return float(np.exp(step)) if abs(step) < LEAST_KNOWN else None


def choices(scene: Scene, fit: Fit, objective: Objective = WHOLE, otherwise: Array | None = None) -> dict[str, dict[str, Any]]:
    """What half the time step would change, and the boundary driven `otherwise` [T, B, 3] m where there is another way."""
    fine = replace(scene.settings, substeps=2 * scene.settings.substeps)
    altered = {"half_step": ("at half the time step", replace(scene, settings=fine))}
    if otherwise is not None:
        altered["other_boundary"] = ("with the boundary driven the other way", replace(scene, boundary_motion=otherwise))
    left = objective.normal(scene, fit.fabric).step
    return {key: _change(objective.normal(other, fit.fabric).step - left, how) for key, (how, other) in altered.items()}


def _change(step: Array, how: str) -> dict[str, Any]:
    """Factors by which the ratios would change, and the sentence; None where a linear step cannot say."""
    if not np.isfinite(step).all():
        return {"sentence": f"{how} the simulation fails"}
    factors = {NAMES[name]: _factor(c) for name, c in zip(PARAMETERS, step)}
    said = [f"{name} would " + (f"change by {100 * (f - 1):+.0f} %" if f else "not be the same at all") for name, f in factors.items()]
    return {"factors": factors, "sentence": f"{how} {', '.join(said)}"}
