"""One person's keypoints through a recording, by all cameras together.

With masks each view stands alone. Without, the box of a view is drawn around the keypoints of the frame before, and a view whose
keypoints disagree with the others in space (another figure, a lost box) is looked at again where the others say the person is:

    x_k = argmin Σ_c w_ck ρ(|π_c(x_k) − u_ck|),   ρ Cauchy's with scale σ;     a view disagrees when its median |π_c(x) − u_c| > limit

Without masks the first boxes are sought in one frame after another until views agree on somebody; frames before that have no keypoints.
Limits: one person; who is found first is followed to the end; at least three views are needed to tell which one is wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from tasks.geometry.cameras import Cameras, project, triangulate
from tasks.keypoints.detector import Detections, Detector
from tasks.keypoints.person_box import LOW, NOWHERE, box_from_keypoints

BODY = slice(0, 23)
CAUCHY_SCALE = 0.02  # of the box's diagonal
DISAGREEMENT = 0.12  # of the box's diagonal: half a shoulder's width, beyond a bad joint, short of another person


@dataclass(frozen=True)
class RigKeypoints:
    """uv [frame,camera,133,2] px of the original pictures, score [frame,camera,133]; box [frame,camera,4] px that was looked at."""

    uv: np.ndarray
    score: np.ndarray
    box: np.ndarray


def follow_masks(detector: Detector, frames: Iterable[tuple[list[np.ndarray], list[np.ndarray]]]) -> RigKeypoints:
    """Keypoints of every frame; `frames` yields (pictures, masks), one of each per camera."""
    return _stacked([detector.detect(images, masks=masks) for images, masks in frames])


def follow_motion(
    detector: Detector, cameras: Cameras, frames: Iterable[list[np.ndarray]], seek: Callable[[list[np.ndarray]], np.ndarray]
) -> RigKeypoints:
    """Keypoints of every frame without masks; `frames` yields the pictures of all cameras, `seek(pictures)` boxes [camera,4] px to begin
    with, all NaN where it sees nobody. Frames without any box have no keypoints."""
    found: list[Detections] = []
    boxes = np.tile(NOWHERE, (len(cameras), 1))
    for images in frames:
        begun = np.isfinite(boxes).any()
        detections = detector.detect(images, boxes=boxes if begun else seek(images), refine=0 if begun else 2)
        if np.isfinite(detections.box).any():
            _look_again(detector, cameras, images, detections)
            boxes = next_boxes(cameras, detections)
        found.append(detections)
    return _stacked(found)


def _look_again(detector: Detector, cameras: Cameras, images: list[np.ndarray], found: Detections) -> None:
    """Replace, in `found`, what views that the others contradict have seen."""
    mended = agreed_boxes(cameras, found, found.box)
    again = np.flatnonzero((mended != found.box).any(1) & np.isfinite(mended).all(1))
    if len(again):
        second = detector.detect([images[c] for c in again], boxes=mended[again], refine=1)
        for old, new in zip((found.uv, found.score, found.box), (second.uv, second.score, second.box)):
            old[again] = new


def agreed_points(cameras: Cameras, uv: np.ndarray, score: np.ndarray, *, scale: float, rounds: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Points x [point,3] m of keypoints uv [camera,point,2] px with scores [camera,point], and residuals [camera,point] px, so that views
    that are wrong by more than `scale` [px] count for little.

    Starts, point by point, from the two views that the others contradict least: with four views one wrong one bends least squares too far.
    """
    score = np.where(np.isfinite(uv).all(-1), score, 0.0)
    weight, least = score.copy(), np.full(uv.shape[1], np.inf)
    for pair in combinations(range(len(cameras)), 2):
        both = np.zeros_like(score)
        both[list(pair)] = score[list(pair)]
        _, residual = triangulate(cameras, uv, both)
        cost = (score * np.log1p((np.where(np.isfinite(residual), residual, np.inf) / scale) ** 2).clip(max=10)).sum(0)
        better = (cost < least) & (both > 0).any(0)
        least[better], weight[:, better] = cost[better], (score / (1 + (residual / scale) ** 2))[:, better]
    for _ in range(rounds):
        x, residual = triangulate(cameras, uv, np.where(np.isfinite(weight), weight, 0.0))
        weight = np.where(np.isfinite(residual), score / (1 + (residual / scale) ** 2), 0.0)
    return x, residual


def next_boxes(cameras: Cameras, found: Detections) -> np.ndarray:
    """Where to look in the next frame [camera,4]: around a view's own body keypoints and around where the views together see them.

    A limb that one view has lost, at the edge of its box, say, comes back by the others; a keypoint that the others contradict does not
    pull the box away.
    """
    common, misfit, limit = _common_boxes(cameras, found, found.box)
    score = found.score.copy()
    score[:, BODY][misfit > limit] = 0.0
    own = np.stack([box_from_keypoints(uv, s, fallback=box) for uv, s, box in zip(found.uv, score, found.box)])
    both = np.concatenate([np.minimum(own[:, :2], common[:, :2]), np.maximum(own[:, 2:], common[:, 2:])], axis=1)
    return np.where(np.isfinite(common), np.clip(both, 0, np.tile(cameras.size, 2)), own)


def agreed_boxes(cameras: Cameras, found: Detections, boxes: np.ndarray) -> np.ndarray:
    """`boxes` [camera,4], with those replaced whose body keypoints disagree with what the other views say, or that are NaN."""
    common, misfit, limit = _common_boxes(cameras, found, boxes)
    missing = ~np.isfinite(found.uv[:, BODY]).all((1, 2))
    disagrees = np.array([(far[~np.isnan(far)] > limit).mean() > 0.5 if not np.isnan(far).all() else False for far in misfit]) | missing
    return np.where((disagrees & np.isfinite(common).all(1))[:, None], common, boxes)


def _common_boxes(cameras: Cameras, found: Detections, boxes: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Boxes [camera,4] around the body keypoints on which views agree, NaN when there are few; how far each view is from these keypoints
    [camera,point] px, NaN where there is no agreement; and how far is too far [px]."""
    diagonal = np.nanmedian(np.linalg.norm(boxes[:, 2:] - boxes[:, :2], axis=1))
    uv, score = found.uv[:, BODY], found.score[:, BODY]
    x, residual = agreed_points(cameras, uv, score, scale=CAUCHY_SCALE * diagonal)
    agree = np.isfinite(residual) & (residual < 2 * CAUCHY_SCALE * diagonal) & (score > LOW)
    trusted = agree.sum(0) >= min(3, len(cameras))  # two views always nearly agree
    seen, _ = project(cameras, x)
    common = np.stack([box_from_keypoints(p, trusted.astype(float), fallback=NOWHERE) for p in seen])
    return common, np.where(trusted, residual, np.nan), DISAGREEMENT * diagonal


def _stacked(found: list[Detections]) -> RigKeypoints:
    return RigKeypoints(*(np.stack([getattr(d, name) for d in found]) for name in ("uv", "score", "box")))
