"""The recorded sleeve: four magnetic trackers on a swinging arm, two on its links and two on the fabric (Sadati et al., IJRR 2020).

Runs are resampled onto one clock whose zero is the first passage of the arm through its rest direction. SI units here: metres, seconds.
"""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

RATE = 40.0  # [1/s]
CORRUPT_MM = 2000.0
WINDOW = (-0.2, 3.5)  # [s] around the first zero crossing
PIVOT = np.array([297.9, -20.7, -267.0]) * 1e-3  # [m] tracker frame
AXIS = np.array([0.0002, 0.0982, 0.9952])  # of the pivot
DOWN = np.array([-0.9999, 0.0146, -0.0012])  # from the pivot to s2 at rest, and so gravity
PAIRS = ((1, 2), (3, 4), (5, 6), (7, 8), (9, 10), (11, 12), (13, 14))
REPEATS = (1, 2, 3, 4, 5)


def folder() -> Path:
    """Where the recordings are."""
    return Path(os.environ.get("PHYSAVATAR_REAL_DATA", Path(__file__).parents[3] / "shared" / "data")) / "sleeve"


@dataclass(frozen=True)
class Run:
    """time [T] s; s1, s2 [T, 3] m on the links; places {number: [T, 3] m}."""

    time: np.ndarray
    s1: np.ndarray
    s2: np.ndarray
    places: dict[int, np.ndarray]


def read_run(pair: tuple[int, int], repeat: int) -> Run:
    """One file, corrupt values interpolated, on the common clock."""
    file = folder() / f"stiff0angle_fabric{pair[0]}and{pair[1]}_test{repeat}.csv"
    rows = np.genfromtxt(file, delimiter=",")
    rows = np.where(np.isfinite(rows) & (np.abs(rows) < CORRUPT_MM), rows, np.nan)
    clock = np.arange(len(rows)) / RATE
    for column in rows.T:
        bad = ~np.isfinite(column)
        column[bad] = np.interp(clock[bad], clock[~bad], column[~bad])
    x = rows.reshape(-1, 4, 3) * 1e-3
    angle = swing_angle(x[:, 1])
    first = int(np.flatnonzero((angle[:-1] > 0) & (angle[1:] <= 0))[0])
    zero = clock[first] + angle[first] / (angle[first] - angle[first + 1]) / RATE
    time = np.arange(WINDOW[0], WINDOW[1], 1 / RATE)
    sampled = np.stack([[np.interp(time + zero, clock, x[:, s, c]) for c in range(3)] for s in range(4)]).transpose(2, 0, 1)
    return Run(time, sampled[:, 0], sampled[:, 1], {pair[0]: sampled[:, 2], pair[1]: sampled[:, 3]})


def swing_angle(s2: np.ndarray) -> np.ndarray:
    """Angle [T] rad of s2 [T, 3] m from its rest direction about the pivot axis, positive towards where the arm is raised."""
    r = s2 - PIVOT
    return np.arctan2(r @ np.cross(AXIS, DOWN), r @ DOWN)


def arm_frame(s1: np.ndarray, s2: np.ndarray) -> np.ndarray:
    """Axes [T, 3, 3] (rows): along s1 to s2, across in the swing plane, and out of it; the origin is s2."""
    a = s2 - s1
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    n = AXIS - (a @ AXIS)[:, None] * a
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    return np.stack([a, np.cross(n, a), n], 1)


def in_arm_frame(run: Run, x: np.ndarray) -> np.ndarray:
    """Points x [T, ..., 3] m as seen from the arm [T, ..., 3] m."""
    s2 = run.s2.reshape(len(x), *(1 for _ in x.shape[2:]), 3)
    return np.einsum("tij,t...j->t...i", arm_frame(run.s1, run.s2), x - s2)


def baselines() -> dict[int, tuple[float, float]]:
    """Held-out errors [mm] per place on repeats 4 and 5: painted on the arm at its mean of repeats 1–3, and mean trajectory of repeats 1–3."""
    found = {}
    for pair in PAIRS:
        runs = {r: read_run(pair, r) for r in REPEATS}
        for place in pair:
            y = {r: in_arm_frame(run, run.places[place]) for r, run in runs.items()}
            path = np.mean([y[r] for r in (1, 2, 3)], axis=0)
            errors = [np.sqrt(np.mean([np.sum((y[r] - guess) ** 2, 1) for r in (4, 5)])) * 1e3 for guess in (path.mean(0)[None], path)]
            found[place] = (float(errors[0]), float(errors[1]))
    return found
