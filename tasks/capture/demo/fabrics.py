"""The cloth of the demo's garments, drawn from ranges measured on real fabrics.

Areal density 0.12-0.24 kg/m², stretch stiffness E·t 150-600 N/m, bending rigidity B 3e-5 to 1.2e-4 N·m: orders of magnitude of firm woven
cotton and wool of skirt weight. Softer cloth folds over less than the edges of the simulated mesh: its bending length (B/ρ̄g)^⅓ would
fall below 23 mm. Both garments are cut from cloth of one weight, so that one weighing gives the density of either.
"""

import numpy as np

from tasks.simulator.fabric import Fabric

AREAL_DENSITY = (0.12, 0.24)  # [kg/m²]
STRETCH = (150.0, 600.0)  # [N/m]
BENDING_RIGIDITY = (3e-5, 1.2e-4)  # [N·m]
FRICTION = 0.2


def draw_fabrics(names: tuple[str, ...], rng: np.random.Generator) -> dict[str, Fabric]:
    """One fabric per garment: log-uniform in each range, the areal density shared."""
    density = _log_uniform(AREAL_DENSITY, rng)
    return {
        name: Fabric.from_si(
            areal_density=density,
            stretch=_log_uniform(STRETCH, rng),
            bending_rigidity=_log_uniform(BENDING_RIGIDITY, rng),
            friction=FRICTION,
        )
        for name in names
    }


def _log_uniform(bounds: tuple[float, float], rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(*np.log(bounds))))
