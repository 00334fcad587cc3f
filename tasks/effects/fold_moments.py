"""Moments that hold hinges folded: the linear part of a rest angle other than the base's."""

import numpy as np

from tasks.effects.stencil_levers import forces, lever
from tasks.simulator.hinge_bending import angle_gradients, angle_hessians
from tasks.simulator.potential import NO_STIFFNESS, Array, Blocks, Indices


def fold_force(x: Array, hinges: Indices, moment: Array) -> Array:
    """Σ moment ∂θ/∂x: [V, 3] for moments [H] N·m, [P, V, 3] for moments [P, H]."""
    return forces(lever(hinges, angle_gradients(x, hinges), len(x)), moment)


def fold_stiffness(x: Array, hinges: Indices, moment: Array, *, convex: bool) -> Blocks:
    """Σ moment ∂²θ/∂x² for moments [H] N·m; its convex neighbour is nothing."""
    if convex or not np.any(moment):
        return NO_STIFFNESS
    return Blocks(hinges, moment[:, None, None] * angle_hessians(x, hinges))
