"""One cloth on another mesh of it: hinges that bend as stiffly.

Hinges converge to no plate unless triangles are well shaped (Grinspun et al. 2006): equilateral triangles cut in halves are three tenths
stiffer than they were, other diagonals up to three tenths, and a right-angled grid is four times as stiff along its diagonals as across
them. To a fit that is nothing: κ_b of a mesh is what makes that mesh bend as the cloth does. Where the same cloth goes onto another mesh,
κ_b therefore becomes

    κ_b exp⟨log (w′_l/w_l)⟩_l,    w_l = p_lᵀ K⁻¹ p_l,    K = Dᵀ diag(3|ē|²/(Ā₁ + Ā₂)) D,    p_l = M q_l

with the work w_l, w′_l that pressures q_l, polynomials of the rest shape's coordinates up to the second degree, do on either mesh as a
plate held at its edges: D folds hinges by deflections (`hinge_bending.folds`), M: areas of vertices. Not by how much energy a given
curvature costs, for between vertices that are free the stiff hinges leave the folding to the soft: of the halves that would make two
thirds.

Source: plates in bending, discretised as in Grinspun et al. 2003. Limits: one number for all directions and places; the rest shape's own
curvature is neglected. A mesh all of whose vertices lie on its edges, as of a ribbon two vertices wide, has no plate to press on: from or
onto such a one κ_b stays.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import diags
from scipy.sparse.linalg import splu

from tasks.effects.effect import Subject
from tasks.geometry.meshes import boundary_edges, components
from tasks.simulator import Cloth
from tasks.simulator.hinge_bending import folds, hinge_shape

Array = NDArray[np.float64]


def retriangulated(subject: Subject, cloth: Cloth) -> Subject:
    """The subject on another mesh of its cloth."""
    before, after = _works(subject.cloth), _works(cloth)
    if not (before.all() and after.all()):
        return replace(subject, cloth=cloth)
    bending = subject.fabric.bending * float(np.exp(np.mean(np.log(after / before))))
    return replace(subject, cloth=cloth, fabric=replace(subject.fabric, bending=bending))


def _works(cloth: Cloth) -> Array:
    """w [10]; zero where no vertex is free."""
    free = np.setdiff1d(np.arange(len(cloth.x_rest)), _held(cloth))
    D = folds(cloth)[:, free]
    p = cloth.vertex_areas[free, None] * _pressures(cloth.x_rest)[free]
    return np.sum(p * splu((D.T @ diags(hinge_shape(cloth)) @ D).tocsc()).solve(p), 0)


def _held(cloth: Cloth) -> NDArray[np.int64]:
    """Vertices on edges of the cloth, and one of each piece that has none."""
    on_edge, piece = np.unique(boundary_edges(cloth.faces)), components(cloth.faces, len(cloth.x_rest))
    first = np.unique(piece, return_index=True)[1]
    return np.union1d(on_edge, first[~np.isin(piece[first], piece[on_edge])])


def _pressures(x: Array) -> Array:
    """q [V, 10] at places x [V, 3] m."""
    one = np.column_stack([np.ones(len(x)), 1 + (x - x.mean(0)) / np.ptp(x, axis=0).max()])
    return np.stack([one[:, i] * one[:, j] for i in range(4) for j in range(i, 4)], 1)
