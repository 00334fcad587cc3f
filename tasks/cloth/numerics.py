"""What the discretisation alone does: the same model on about twice the vertices with half the step, window by window.

The difference at the given vertices enters as a column whose coefficient is 1 ± 1: the finer run is closer to the limit by about as much as it
differs, and nobody knows the recording's own mesh. Without it a method blames innocent effects on every recording made on another mesh.

Source: Roache 1994 (Richardson's estimate of discretisation error). Limits: first order; folds that differ in kind are not corrected.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.shooting import Evidence, Job
from tasks.cloth.windows import Normals, marginalised, predict
from tasks.effects.model import Model
from tasks.effects.numerics_mesh import EFFECT as MESH

Array = NDArray[np.float64]

SPREAD = 1.0  # standard deviation of the coefficient


def finer_offset(job: Job, coarse: Array) -> Array | None:
    """x(finer) − x(coarse) [L, V, 3] m of a window whose coarse prediction is [L + 1, V, 3] m; None where the finer run fails."""
    settings = replace(job.model.settings, substeps=2 * job.model.settings.substeps)
    found = predict(on_finer_mesh(replace(job.model, settings=settings)), job.recording, job.window, job.states)
    return found.x[1:, : coarse.shape[1]] - coarse[1:] if found.complete else None


def on_finer_mesh(model: Model) -> Model:
    """The model on about twice the vertices, the given ones first."""
    return model.joined([MESH], {MESH.name: np.ones(1)})


def corrected(n: Normals) -> Normals:
    """Normal equations with the column "numerics" taken at 1 ± `SPREAD`; as they are where there is none."""
    if "numerics" not in n.names:
        return n
    k = n.names.index("numerics")
    shifted = replace(n, g=n.g - n.G[:, k], c=float(n.c - 2 * n.g[k] + n.G[k, k]))
    return marginalised(shifted, ["numerics"], np.array([SPREAD**2]))


def size(evidence: Evidence) -> float:
    """Root mean square of the numerics column [m] of a followed window, start state taken out."""
    column = evidence.prediction.columns.get("numerics")
    return 0.0 if column is None else float(np.sqrt(np.mean(np.sum(column**2, -1))))
