"""Tracking on the synthetic skirt: accuracy, cost, the ablation of the supplement (B.1), calibration of the noise, and a hard case.

`python -m tests.benchmarks.tracking` prints metric | value | target | holds; JSON=1 the same as JSON, QUICK=1 three frames instead of ten.
"""

import os
import time
from itertools import chain

import numba
import numpy as np

from tests.benchmarks.table import show
from tests.tracking.scores import normal_error, rmse, track
from tests.tracking.skirt import skirt


def main() -> None:
    """Measure and print."""
    frames = 3 if os.environ.get("QUICK") == "1" else 10
    show(chain(_accuracy_and_cost(frames), _ablation(min(frames, 6)), _hard_case(min(frames, 6))))


def _accuracy_and_cost(frames):
    """Ten frames, eight views of 512²; CPU seconds on one thread, compilation excluded."""
    s = skirt(frames=frames)
    numba.set_num_threads(1)
    track(s, frames=2)
    start = time.process_time()
    first = track(s, frames=1)
    once = time.process_time() - start
    start = time.process_time()
    found = track(s)
    cpu = (time.process_time() - start - once) / (frames - 1)
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
    threaded = track(s, frames=2)
    worst = max(rmse(found.vertices[t], s.vertices[t]) for t in range(1, frames))
    e, seen, σ = found.vertices[1:] - s.vertices[1:], found.seen[1:], found.noise_m[1:]
    within = (np.abs(e[seen]) < 2 * σ[seen][:, None]).mean()
    same = np.array_equal(threaded.vertices, found.vertices[:2]) and np.array_equal(first.vertices, found.vertices[:1])
    yield "RMSE of the worst frame [mm]", worst * 1e3, "< 3", worst < 0.003
    yield "untracked, for comparison [mm]", rmse(s.vertices[0], s.vertices[-1]) * 1e3, "-", None
    yield "CPU seconds per frame", cpu, "<= 4.75", cpu <= 4.75
    yield "share of coordinates within 2 sigma", within, "0.90..0.99", 0.90 < within < 0.99
    yield "vertices seen", seen.mean(), "> 0.95", seen.mean() > 0.95
    yield "same bits on another number of threads", same, "1", same


def _ablation(frames):
    s = skirt(frames=10 if frames > 3 else 3)
    truth, faces = s.vertices[frames - 1], s.faces
    full, free, rough = (track(s, frames=frames, **change).vertices[-1] for change in ({}, {"sigma_strain": 1e6}, {"sigma_normal": 1e6}))
    iso = rmse(free, truth) / rmse(full, truth)
    normal = normal_error(rough, truth, faces) / normal_error(full, truth, faces)
    yield "RMSE without ISO over full", iso, "> 3", iso > 3
    yield "normal error without normal term over full", normal, "> 1.5", normal > 1.5


def _hard_case(frames):
    """Cloth of one colour with a fine weave, four views, sensor noise of 1 %: shape from outline and shading only."""
    s = skirt(frames=frames, views=4, texture="plain", noise=0.01)
    found = track(s)
    e, seen, σ = found.vertices[1:] - s.vertices[1:], found.seen[1:], found.noise_m[1:]
    held = rmse(s.vertices[0], s.vertices[-1])
    share = rmse(found.vertices[-1], s.vertices[-1]) / held
    within = (np.abs(e[seen]) < 2 * σ[seen][:, None]).mean()
    yield "plain cloth, 4 views, noise: error over untracked", share, "< 0.5", share < 0.5
    yield "plain cloth, 4 views, noise: within 2 sigma", within, "0.90..0.99", 0.90 < within < 0.99


if __name__ == "__main__":
    main()
