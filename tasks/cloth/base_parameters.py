"""The base parameters θ = (log κ_s, log κ_b) of a fabric: their bounds, and a step of them.

The density is held: without air, motion depends on κ_s/ρ and κ_b/ρ only, so bounds and logarithms are those of the fabric of 320 kg/m³ that
moves alike.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tasks.effects.model import Model
from tasks.simulator import Fabric

Array = NDArray[np.float64]
PARAMETERS = ("log_membrane", "log_bending")
REFERENCE_DENSITY = 320.0  # [kg/m³] the bounds hold for κ · 320/ρ: they limit the ratios
BOUNDS = {"log_membrane": (np.log(0.02), np.log(200.0)), "log_bending": (np.log(0.1), np.log(500.0))}


def logarithms(fabric: Fabric) -> Array:
    """log κ_s and log κ_b of the fabric of density 320 kg/m³ that moves like this one [P]."""
    return np.log(np.array([fabric.membrane, fabric.bending]) * REFERENCE_DENSITY / fabric.density)


def moved(fabric: Fabric, step: Array) -> tuple[Fabric, Array]:
    """The fabric after a step [P] of the logarithms, within bounds and of the same density, and the step that was possible."""
    low, high = np.array([BOUNDS[name] for name in PARAMETERS]).T
    now = logarithms(fabric)
    then = np.clip(now + step, low, high)
    membrane, bending = np.exp(then) * fabric.density / REFERENCE_DENSITY
    return replace(fabric, membrane=float(membrane), bending=float(bending)), then - now


def with_fabric(model: Model, fabric: Fabric) -> Model:
    """The model with another fabric."""
    return replace(model, subject=replace(model.subject, fabric=fabric))
