"""Base refit only: κ_s and κ_b as the diagnosis fits them, and nothing is ever missing.

What it is: the floor of every figure, and the model whose replay "before" is. What it is not: a diagnosis; it names nobody.
Source: the parameter estimation of PhysAvatar, by multiple shooting (`cloth/shooting.py`).
"""

import numpy as np

from tasks.cloth.shooting import BaseFit, refit
from tasks.cloth.state_modes import smooth_modes
from tasks.exam.rivals.rival import NONE, Case, Reply, Rival
from tasks.gap.acceleration import residual_acceleration
from tasks.gap.gathered import Gathered, gather, jobs
from tasks.gap.screening import MODES


def base_refit(case: Case) -> Reply:
    """None, whatever the residual."""
    _, base = refitted(case)
    return Reply({NONE: 0.0}, base.model, base.model, vertex_accel=residual_acceleration(base.evidence, case.model.subject.fps))


def refitted(case: Case) -> tuple[Gathered, BaseFit]:
    """States and windows of all recordings, and the base model fitted to them."""
    data = gather(case.model, case.recordings, case.run)
    φ = smooth_modes(case.model.subject.cloth, MODES)
    noise = float(np.median([np.median(r.noise) for r in case.recordings]))
    return data, refit(jobs(case.model, data, φ), noise=noise, run=case.run)


RIVAL = Rival(
    "base_refit",
    "refits the base parameters and names nothing",
    "Zheng et al. 2024 (PhysAvatar), estimation of the fabric",
    base_refit,
)
