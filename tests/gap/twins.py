"""Twins on the same mesh: a skirt that swings, made and diagnosed by the same simulator, so that nothing but noise is missing."""

import numpy as np

from tasks.cloth.base_refit import refit
from tasks.cloth.nuisances import without_nuisances
from tasks.cloth.shooting import Job
from tasks.cloth.start_state import states
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import windows
from tests.cloth.test_windows import FPS, swung

NOISE = 1e-3
MODES = 40


def null_misfit(seed: int) -> float:
    """χ²/N of a panel of 49 vertices over 31 frames with 1 mm of noise: base refitted, start states marginalised, N less the two parameters."""
    model, recording, *_ = swung(31, noise=NOISE, seed=seed)
    walked = states(model, recording.motion, recording.observed, NOISE)
    φ = smooth_modes(model.subject.cloth, MODES)
    fit = refit([Job(model, recording, w, walked, φ) for w in windows([recording], FPS)], noise=NOISE)
    found = [without_nuisances(e.normals, fit.prior) for e in fit.evidence if e.prediction.complete]
    return sum(n.c for n in found) / (sum(n.n for n in found) - 2)


def mean_null_misfit(seeds: range) -> float:
    """Mean over seeds."""
    return float(np.mean([null_misfit(seed) for seed in seeds]))
