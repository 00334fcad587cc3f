"""What the computation alone does: the same model computed otherwise, window by window.

    D_e = x(computed otherwise in the way e) − x      [L, V, 3] m, at the given vertices

enters as a column of the effect's name whose coefficient is μ ± 1: μ = 1 for what is `FINER` (about twice the vertices, half the step), for
that is closer to the limit by about as much as it differs; μ = 0 for what is only other (other triangles, other laws of stretch, fold and
contact), for nobody knows the recording's own. A law enters by its tangent, from the same simulation as every effect's (`LINEAR`); the rest
is simulated again (`AGAIN`). Without them a method blames innocent effects on every recording that another simulator, or the world, has
made.

What the finer computation still lacks is like D_e in size, not in shape: windows of a twin tell the coefficients to 0.01 to 0.4 and
disagree about them by up to ten times that. Integrating them out, window by window, does not stand for it, and the jackknife over windows
sees only what differs between them, while mesh and step err in all alike. How far answers to two computations lie apart is added
(`common_error`): a unit of D_e in every window moves the answer by

    c_e = (Σ_w G_θθ)⁻¹ Σ_w G_θe,        common covariance Σ_e c_e c_eᵀ,        e in `FINER`

with G the normal equations of windows over their scales, the start state integrated out, the columns D_e kept. It does not shrink with the
number of windows.

Source: Roache 1994 (Richardson's estimate of discretisation error, and the change between two meshes as the uncertainty of any answer, his
grid convergence index; its safety factor here is 1); Kennedy & O'Hagan 2001 (what is known to be uncertain is integrated out); GUM 2008, §
F.1.2.3 (what observations share does not average out).
Limits: first order; folds that differ in kind are not corrected; the sign and size of what is left are nobody's knowledge, hence one
standard deviation.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.base_refit import scale, summed
from tasks.cloth.gauss_newton import RCOND
from tasks.cloth.shooting import Evidence, Job
from tasks.cloth.windows import Normals, marginalised, predict
from tasks.effects.effect import Effect
from tasks.effects.model import Model
from tasks.effects.numerics_bending import EFFECT as BENDING
from tasks.effects.numerics_contact import EFFECT as CONTACT
from tasks.effects.numerics_material import EFFECT as MATERIAL
from tasks.effects.numerics_mesh import EFFECT as MESH
from tasks.effects.numerics_time_step import EFFECT as TIME_STEP
from tasks.effects.numerics_triangulation import EFFECT as TRIANGULATION

Array = NDArray[np.float64]

FINER = (MESH, TIME_STEP)
AGAIN = (*FINER, TRIANGULATION, CONTACT)
LINEAR = (MATERIAL, BENDING)
WAYS = tuple(way.name for way in (*AGAIN, *LINEAR))
SPREAD = 1.0  # standard deviation of a coefficient


def offsets(job: Job, coarse: Array, ways: Sequence[Effect] = AGAIN) -> dict[str, Array]:
    """name -> x(otherwise) − x(coarse) [L, V, 3] m of a window whose own prediction is `coarse` [L + 1, V, 3] m; without those that fail."""
    found = {}
    for way in ways:
        if way is not CONTACT or len(job.recording.collider.faces):
            x = predict(otherwise(job.model, way), job.recording, job.window, job.states)
            if x.complete:
                found[way.name] = x.x[1:, : coarse.shape[1]] - coarse[1:]
    return found


def with_tangents(model: Model) -> Model:
    """The model with the tangents of the ways that have one."""
    return model.joined(LINEAR, {})


def otherwise(model: Model, *ways: Effect) -> Model:
    """The model computed in other ways; a finer mesh has the given vertices first."""
    return model.joined(ways, {way.name: way.typical for way in ways})


def on_finer_mesh(model: Model) -> Model:
    """The model on about twice the vertices, the given ones first."""
    return otherwise(model, MESH)


def finer_computed(model: Model) -> Model:
    """The model on the finer mesh and at half the step: what windows are corrected towards."""
    return otherwise(model, *FINER)


def corrected(n: Normals) -> Normals:
    """Normal equations with the columns of numerics taken at their means and integrated out; as they are where there are none."""
    return without_others(n.stepped(finer_shift(n.names)))


def common_error(windows: Sequence[Normals], names: Sequence[str]) -> Array:
    """Covariance [P, P] of what a finer computation does to the parameters `names` in all windows alike; 0 where they lack its columns."""
    ways, P = [way.name for way in FINER if way.name in windows[0].names], len(names)
    G, _ = summed([replace(n, G=n.G / scale(corrected(n))) for n in windows], (*names, *ways))
    c = SPREAD * np.linalg.pinv(G[:P, :P], rcond=RCOND, hermitian=True) @ G[:P, P:]
    return c @ c.T


def without_others(n: Normals, kept: str = "") -> Normals:
    """Normal equations with the columns of numerics but one integrated out."""
    ways = [way for way in WAYS if way in n.names and way != kept]
    return marginalised(n, ways, np.full(len(ways), SPREAD**2)) if ways else n


def finer_shift(names: Sequence[str]) -> Array:
    """Coefficients [P] of the columns that make up the finer computation: 1 for each of `FINER`, else 0."""
    return np.isin(names, [way.name for way in FINER]).astype(float)


def finer(columns: Mapping[str, Array]) -> Array | float:
    """Sum of the columns of `FINER`: what a finer computation adds; 0 where there are none."""
    return sum((columns[way.name] for way in FINER if way.name in columns), 0.0)


def size(evidence: Evidence) -> float:
    """Root mean square [m] of what a finer computation adds to a followed window, start state taken out."""
    return float(np.sqrt(np.mean(np.sum(np.square(np.atleast_1d(finer(evidence.prediction.columns))), -1))))
