"""How far off start states are, and how errors of tracking are correlated: what makes the windows likeliest.

    minimise over P and the correlation in R    Σ_w r_wᵀ C_w⁻¹ r_w + log|C_w|,    C_w = R + S_z P S_zᵀ

on a grid of sizes.

Source: type-II maximum likelihood (Good 1965; MacKay 1992).
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.nuisances import Prior, without_forcing, without_nuisances, without_state
from tasks.cloth.shooting import Evidence, Job, Map
from tasks.cloth.tracking_noise import IN_ONE_FRAME, Correlation
from tasks.cloth.windows import Normals, normals, predict

Array = NDArray[np.float64]
SIGMA_X = (0.1, 0.3, 1.0, 3.0)  # candidates for σ_x, of the noise,
SIGMA_V = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)  # for σ_v [m/s],
SIGMA_A = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0)  # and for σ_a [m/s²]


def estimated_prior(evidence: Sequence[Evidence], noise: float, near: Prior | None = None) -> Prior:
    """The σ_x, σ_v, and σ_a where there is forcing, of highest marginal likelihood on a grid, one after the other, from those `near`; what
    base parameters could explain is left in. Forcing has the first say: a wide prior of the start would take for error what pushes the
    cloth.
    """
    done = [e.normals for e in evidence if e.prediction.complete]
    forced = any(name.startswith("a ") for n in done[:1] for name in n.names)
    candidates = {"a": SIGMA_A if forced else (0.0,), "x": [s * noise for s in SIGMA_X], "v": SIGMA_V}
    prior = near or (Prior(candidates["x"][0], SIGMA_V[0]) if forced else Prior(noise, 0.1))
    for _ in range(1 if near else 2):
        for name, values in candidates.items():
            close = [v for v in values if near is None or _neighbours(values, getattr(near, name), v)]
            prior = min((replace(prior, **{name: v}) for v in close), key=lambda p: minus_log_likelihood(done, p))
    return prior


def _neighbours(grid: Sequence[float], a: float, b: float) -> bool:
    return abs(int(np.argmin(np.abs(np.subtract(grid, a)))) - int(np.argmin(np.abs(np.subtract(grid, b))))) <= 1


def minus_log_likelihood(normals: Sequence[Normals], prior: Prior) -> float:
    """Σ_w r_wᵀC_w⁻¹r_w + log|C_w|."""
    each = [without_nuisances(n, prior) for n in normals]
    return sum(n.c + n.logdet for n in each)


def estimated_correlation(jobs: Sequence[Job], prior: Prior, noise: float, run: Map = map) -> Correlation:
    """The correlation of the tracker's errors of highest marginal likelihood, over a few windows: what neighbours share, then how long it
    lasts. σ_x and σ_a, which would take shared errors for motion, are chosen along with it.
    """
    in_one = _likeliest(IN_ONE_FRAME, jobs, prior, noise, run)
    return _likeliest(in_one.lasting(), jobs, prior, noise, run) if in_one.share else in_one


def _likeliest(candidates: Sequence[Correlation], jobs: Sequence[Job], prior: Prior, noise: float, run: Map) -> Correlation:
    each = [losses for losses in run(_losses, [(job, prior, noise, candidates) for job in jobs]) if losses is not None]
    return candidates[int(np.argmin(np.sum(each, 0).min(1)))] if each else candidates[0]


def _losses(job: tuple[Job, Prior, float, Sequence[Correlation]]) -> Array | None:
    """−2 log likelihood of a window [candidate, σ_x and σ_a]."""
    todo, prior, noise, candidates = job
    found = predict(todo.model, todo.recording, todo.window, todo.states, parameters=(), φ=todo.φ, forced=True)
    if not found.complete:
        return None
    each = [normals(found, replace(todo.recording, correlation=c), todo.model.subject) for c in candidates]
    freed = [[without_state(n, replace(prior, x=s * noise)) for s in SIGMA_X] for n in each]
    pushed = [[without_forcing(n, a) for n, a in product(of, SIGMA_A[::2])] for of in freed]
    return np.array([[n.c + n.logdet for n in of] for of in pushed])
