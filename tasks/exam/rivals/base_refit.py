"""Base refit only: κ_s and κ_b as the diagnosis fits them, and nothing is ever missing.

What it is: the floor of every figure, the base as the diagnosis has it before whole recordings are replayed. What it is not: a diagnosis;
it names nobody.
Source: the parameter estimation of PhysAvatar, by multiple shooting (`cloth/base_refit.py`).
"""

from tasks.exam.rivals.rival import NONE, Case, Reply, Rival
from tasks.gap.acceleration import residual_acceleration


def base_refit(case: Case) -> Reply:
    """None, whatever the residual."""
    _, base = case.refitted
    return Reply({NONE: 0.0}, base.model, base.model, vertex_accel=residual_acceleration(base.evidence, case.model.subject.fps))


RIVAL = Rival(
    "base_refit",
    "refits the base parameters and names nothing",
    "Zheng et al. 2024 (PhysAvatar), estimation of the fabric",
    base_refit,
    refits=True,
)
