"""Starts of windows without the wrinkles that noise leaves in states.

The places of a state are told by one frame, and what the marginalised modes do not hold of their errors stays: states of a skirt of
300 vertices lie 3.6 mm from what was seen with 4 mm of noise, so that some 1.8 stay. Simulated, such wrinkles swing, as nothing in the
recording does. Whatever calms cloth, damping, hysteresis, or a tracker that smooths, then explains the recording, in every window by the
same strength, for its derivative holds the very wrinkles that the residual holds (errors in variables, Fuller 1987, § 1.1).

So a window is followed with `FINE` modes, and its state moved in those beyond the marginalised ones by the posterior mean

    z = (S_zᵀR⁻¹S_z + P⁻¹)⁻¹ S_zᵀR⁻¹r,    P: errors of tracking in one frame as modes see them (`start_errors.py`)

A third of a second tells them where one frame did before. S_zᵀ(R + S_z P S_zᵀ)⁻¹r = S_zᵀR⁻¹(r − S_z z): for what is weighed afterwards they
are all but marginalised; where there are few windows, they are marginalised whole (`without_wrinkles`). Limits: to first order; noise in
shorter wrinkles stays.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.nuisances import Prior, state_names, state_weights
from tasks.cloth.shooting import Evidence, Job, first_nearer, follow
from tasks.cloth.start_errors import mode_of, start_variances
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import Normals, marginalised

Array = NDArray[np.float64]

FINE = 120  # modes


def unwrinkled_start(job: Job) -> tuple[Array, Array]:
    """x [V, 3] m and v [V, 3] m to start the window from; those of the state where no nearer ones are found. `job.φ` [K, V]: the modes that
    are marginalised.
    """
    fine = replace(job, recording=job.recording.forgetful, φ=smooth_modes(job.model.subject.cloth, FINE), parameters=())
    found, start = follow(fine), {}
    if found.prediction.complete:
        names = state_names(found.normals.names)
        asked = state_weights(found.normals, names, [], _variances(fine, names))[:, 0]
        start, _ = first_nearer(fine, {n: z for n, z in zip(names, asked, strict=True) if mode_of(n) >= len(job.φ)}, found.prediction.x)
    states = replace(fine, start=start).started
    return states.x[job.window.start], states.v[job.window.start]


def without_wrinkles(job: Job, found: Evidence, prior: Prior, modes: int) -> Normals:
    """Normal equations of a window followed with `FINE` modes, its start state marginalised: the first `modes` by their prior, the others
    as noise leaves them.
    """
    names = state_names(found.normals.names)
    smooth = np.array([mode_of(name) < modes for name in names])
    return marginalised(found.normals, names, np.where(smooth, prior.variances(names), _variances(job, names)))


def _variances(job: Job, names: Sequence[str]) -> Array:
    return start_variances(job.recording, job.model.subject, job.φ, names)
