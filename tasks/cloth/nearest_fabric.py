"""Where the base refit begins: of fabrics far apart the one that comes nearest, then of those about it.

Gauss–Newton goes downhill from where it is, and the loss over windows of a third of a second has more than one valley: a skirt whose body was
recorded 20 mm too small ended at ten times its κ_s/ρ from where its short windows had led, with a misfit of 14.9; begun near its own fabric,
still without the larger body, at 6.1. What a cause does is told apart from what is there only about a fabric that is nearly right. So fabrics
softer and stiffer, stretched and bent, are tried before any step is taken, first by one factor of `FACTORS`, then by the other:

    argmin over (κ_s, κ_b) of Σ_w n_w log(r_wᵀ C_w⁻¹ r_w/n_w)        C_w as in `base_refit.py`, start states marginalised

Source: multistart (Rinnooy Kan & Timmer 1987). Limits: nine fabrics each time, on the windows given; a valley between them may be missed.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.base_parameters import moved, with_fabric
from tasks.cloth.base_refit import unscaled_loss
from tasks.cloth.likeliest_errors import estimated_prior
from tasks.cloth.nuisances import Prior, without_nuisances
from tasks.cloth.shooting import Evidence, Job, Map, follow
from tasks.simulator import Fabric

FACTORS = (4.0, 2.0)


def searched(jobs: Sequence[Job], first: Fabric, *, noise: float, run: Map = map) -> Fabric:
    """The nearest found of the fabrics about `first`, that of the jobs, and those about whichever of them is the nearest."""
    each = list(dict.fromkeys([jobs[0].model.subject.fabric, *about(first, FACTORS[0])]))  # where short windows moved nothing, one twice
    found = nearest_fabric(jobs, each, noise=noise, run=run)
    return nearest_fabric(jobs, about(found, FACTORS[1]), noise=noise, run=run)


def nearest_fabric(jobs: Sequence[Job], fabrics: Sequence[Fabric], *, noise: float, run: Map = map) -> Fabric:
    """Of `fabrics`, the one with which most windows `jobs` can be followed, and of such ones the nearest; noise [m] per coordinate."""
    each = followed_in(fabrics, jobs, run)
    prior = estimated_prior([e for evidence in each for e in evidence], noise)
    return fabrics[min(range(len(fabrics)), key=lambda k: _distance(each[k], prior))]


def followed_in(fabrics: Sequence[Fabric], jobs: Sequence[Job], run: Map = map) -> list[list[Evidence]]:
    """Of each fabric, each window."""
    found = list(run(follow, [replace(job, model=with_fabric(job.model, fabric)) for fabric in fabrics for job in jobs]))
    return [found[k : k + len(jobs)] for k in range(0, len(found), len(jobs))]


def about(fabric: Fabric, factor: float) -> list[Fabric]:
    """The fabric, and those by a factor softer and stiffer in either or both ways, within bounds."""
    steps: list[NDArray[np.float64]] = [np.log(factor) * np.array(signs, float) for signs in product((0, -1, 1), repeat=2)]
    return [fabric, *(moved(fabric, step)[0] for step in steps[1:])]


def _distance(evidence: Sequence[Evidence], prior: Prior) -> tuple[int, float]:
    """Windows that cannot be followed, and the loss of the others, per coordinate."""
    followed = [without_nuisances(e.normals, prior) for e in evidence if e.prediction.complete]
    loss = sum(unscaled_loss(n) for n in followed) / max(sum(n.n for n in followed), 1)
    return len(evidence) - len(followed), loss
