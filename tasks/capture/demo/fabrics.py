"""The cloth of the demo's garments, drawn from ranges measured on real fabrics.

Areal density 0.035-0.07 kg/m², stretch stiffness E·t 44-175 N/m, bending length (B/ρ̄g)^⅓ 46-58 mm (B 0.3e-4 to 1.3e-4 N·m): orders of
magnitude of organza, light and stiff, so that the air they move in shows within a second. Softer cloth folds over less than 1.3 edges of
the template (33 mm): a mesh of that size cannot show its bending (`tasks/cloth/estimates.py` says so then), and differs from the finer one
by more than what it is to find. Both garments are cut from cloth of one weight, so that one weighing gives the density of either.
"""

import numpy as np

from tasks.simulator.fabric import Fabric

AREAL_DENSITY = (0.035, 0.07)  # [kg/m²]
STRETCH = (44.0, 175.0)  # [N/m]
BENDING_LENGTH = (0.046, 0.058)  # [m]
FRICTION = 0.2
GRAVITY = 9.81  # [m/s²]


def draw_fabrics(names: tuple[str, ...], rng: np.random.Generator) -> dict[str, Fabric]:
    """One fabric per garment: log-uniform in each range, the areal density shared."""
    density = _log_uniform(AREAL_DENSITY, rng)
    return {
        name: Fabric.from_si(
            areal_density=density,
            stretch=_log_uniform(STRETCH, rng),
            bending_rigidity=density * GRAVITY * _log_uniform(BENDING_LENGTH, rng) ** 3,
            friction=FRICTION,
        )
        for name in names
    }


def _log_uniform(bounds: tuple[float, float], rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(*np.log(bounds))))
