"""Left and right as the cameras agree on them: a view that takes the back of a person for the front has all sides swapped.

For each frame the body's points x are found robustly from all views; a view is turned round, uv_k ← uv_flip(k), where that fits x better:

    Σ_k w_k log(1 + |π(x_k) − u_flip(k)|²/σ²) < GAIN · Σ_k w_k log(1 + |π(x_k) − u_k|²/σ²)        over points that have two sides

and x is found again until nothing turns, ROUNDS times at most. Limit: the majority decides; if most views are wrong, all end up wrong
together, and where half of them are, either may happen.
"""

import numpy as np

from tasks.body.wholebody import FLIP
from tasks.geometry.cameras import Cameras, project
from tasks.keypoints.rig_keypoints import BODY, CAUCHY_SCALE, RigKeypoints, agreed_points

GAIN = 0.8  # a view turns only for a clear gain: from the side both readings fit alike
ROUNDS = 3
SIDED = np.flatnonzero(
    (np.arange(len(FLIP)) != FLIP) & (np.arange(len(FLIP)) < BODY.stop) & (np.arange(len(FLIP)) > 4)
)  # shoulders to toes


def same_sides(cameras: Cameras, found: RigKeypoints) -> tuple[RigKeypoints, np.ndarray]:
    """The keypoints with views turned round where the others say so, and which were [frame, camera]; frames without boxes stay."""
    uv, score = found.uv.copy(), found.score.copy()
    turned = np.zeros(uv.shape[:2], bool)
    for t in np.flatnonzero(np.isfinite(found.box).any((1, 2))):
        diagonal = np.nanmedian(np.linalg.norm(found.box[t, :, 2:] - found.box[t, :, :2], axis=1))
        for _ in range(ROUNDS):
            wrong = _swapped(cameras, uv[t], score[t], CAUCHY_SCALE * diagonal)
            if not wrong.any():
                break
            uv[t, wrong], score[t, wrong] = uv[t, wrong][:, FLIP], score[t, wrong][:, FLIP]
            turned[t] ^= wrong
    return RigKeypoints(uv, score, found.box), turned


def _swapped(cameras: Cameras, uv: np.ndarray, score: np.ndarray, scale: float) -> np.ndarray:
    """Views [camera] that fit the others better with sides swapped: the one that gains most, and those that gain at least half as much."""
    x, _ = agreed_points(cameras, uv[:, BODY], score[:, BODY], scale=scale)
    seen = project(cameras, x)[0][:, SIDED]
    as_is, swapped = (_misfit(seen, uv[:, k], score[:, k], scale) for k in (SIDED, FLIP[SIDED]))
    gain = np.where(swapped < GAIN * as_is, as_is - swapped, 0.0)
    return (gain > 0) & (gain >= 0.5 * gain.max())


def _misfit(seen: np.ndarray, uv: np.ndarray, score: np.ndarray, scale: float) -> np.ndarray:
    each = score * np.log1p(np.sum((seen - uv) ** 2, -1) / scale**2)
    return np.nansum(each, axis=1)
