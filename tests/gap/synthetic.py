"""Windows with random signatures of one standard deviation per typical strength and coordinate, and a truth among them."""

import numpy as np

from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.windows import Normals
from tasks.effects.library import library
from tasks.gap.hypotheses import Windows

LIBRARY = library()
EFFECTS = [LIBRARY[n] for n in ("air_normal_drag", "fabric_mass_damping", "contact_friction", "fabric_hem_mass", "gravity_tilt")]
NAMES = [*PARAMETERS, *(c for e in EFFECTS for c in e.columns)]
TYPICAL = {c: abs(s.typical) for e in EFFECTS for c, s in zip(e.columns, e.strengths, strict=True)}


def normals(A, r):
    return Normals(tuple(NAMES), A.T @ A, A.T @ r, float(r @ r), len(r))


def dense(rng, truth, *, count=10, n=200, alike=0.0):
    """Signatures A [n, P] and residuals r [n] of windows; truth(k): column -> strength in window k; alike: share of damping in drag."""
    found = []
    for k in range(count):
        A = rng.standard_normal((n, len(NAMES)))
        i, j = NAMES.index("air_normal_drag"), NAMES.index("fabric_mass_damping")
        A[:, i] = np.sqrt(1 - alike**2) * A[:, i] + alike * A[:, j]
        A /= [TYPICAL.get(name, 1.0) for name in NAMES]
        own = truth(k)
        found.append((A, A @ [own.get(name, 0.0) for name in NAMES] + rng.standard_normal(n)))
    return found


def windows(rng, truth, **options):
    return Windows([normals(A, r) for A, r in dense(rng, truth, **options)], EFFECTS)
