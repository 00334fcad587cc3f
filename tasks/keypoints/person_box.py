"""Where the person is in each view: from a mask, from keypoints already found, or, without either, from what moves.

    foreground(t) = |I(t) − median_t I| > threshold → boxes per view;     the person = the set of boxes, one per view, whose middles, tops
    and feet meet in space best (rays, triangulation) and that moves most

Several figures may move or stand in a view; the one that was recorded is the one that all cameras see in the same place.
Limits: the person must move over the clip by more than a limb's width, or enter it, and not stand in one place for most of it; cameras
must stand still; two people who both walk before all cameras are told apart by amount of movement alone.
"""

from __future__ import annotations

from itertools import combinations, product

import cv2
import numpy as np

from tasks.geometry.cameras import Cameras, project, triangulate

NOWHERE = np.full(4, np.nan)
THRESHOLD = 22.0  # grey levels of 255, the largest channel's difference: above compression noise, below skin against wall
LOW, HIGH = 0.25, 0.5  # scores: a keypoint counts for a box; a keypoint is sure
LEAST_PIXELS = 60  # at the working height: a forearm
WORKING_HEIGHT = 270  # [px] pictures are compared at this height


def box_from_mask(mask: np.ndarray) -> np.ndarray:
    """Box (left, top, right, bottom) px around a mask [height,width] (bool, or float above ½); NaN when it is empty."""
    on = np.asarray(mask) > 0.5
    rows, columns = np.flatnonzero(on.any(1)), np.flatnonzero(on.any(0))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], float) if len(rows) else NOWHERE


def box_from_keypoints(uv: np.ndarray, score: np.ndarray, *, fallback: np.ndarray) -> np.ndarray:
    """Box around the body and feet keypoints with a score above 0.25 (uv [133,2] px, score [133]), grown by the flesh around joints;
    `fallback` [4] when fewer than six are found."""
    sure = (score[:23] > LOW) & np.isfinite(uv[:23]).all(1)
    if sure.sum() < 6:
        return fallback
    low, high = uv[:23][sure].min(0), uv[:23][sure].max(0)
    margin = 0.08 * (high - low).max()
    return np.concatenate(
        [low - margin - [0, 0.5 * margin], high + margin]
    )  # the head reaches higher above the eyes than feet below ankles


def moving_boxes(frames: list[np.ndarray], median: np.ndarray, *, count: int = 3) -> list[np.ndarray]:
    """Up to `count` boxes px of what differs from `median` [height,width,3], most changed first: a list over `frames` of [n,4]."""
    scale = WORKING_HEIGHT / median.shape[0]
    size = (round(median.shape[1] * scale), WORKING_HEIGHT)
    still = cv2.resize(median, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    boxes = []
    for frame in frames:
        difference = np.abs(cv2.resize(frame, size, interpolation=cv2.INTER_AREA) - still).max(2)
        on = cv2.morphologyEx((difference > THRESHOLD).astype(np.uint8), cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
        # a body shows as pieces where skin and wall are alike: join pieces closer than a tenth of the picture's height
        joined = cv2.morphologyEx(on, cv2.MORPH_CLOSE, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (27, 27)))
        count_of_pieces, label = cv2.connectedComponents(joined)
        energy = np.bincount(label[on > 0], minlength=count_of_pieces)
        energy[0] = 0
        chosen = [k for k in np.argsort(-energy)[:count] if energy[k] > LEAST_PIXELS]
        boxes.append(np.array([box_from_mask((label == k) & (on > 0)) for k in chosen]).reshape(-1, 4) / scale)
    return boxes


def moving_person(cameras: Cameras, still: list[np.ndarray], images: list[np.ndarray]) -> np.ndarray:
    """Boxes [camera,4] px of the one who moves in `images`, one RGB picture per camera, against what stands `still` in each
    (`temporal_median`); NaN where a view shows nobody, in all of them where no two agree."""
    return same_person(cameras, [moving_boxes([image], background)[0] for image, background in zip(images, still, strict=True)])


def temporal_median(frames: list[np.ndarray], *, samples: int = 25) -> np.ndarray:
    """Median picture [height,width,3] uint8 of evenly spread frames: what stands still."""
    picked = np.linspace(0, len(frames) - 1, min(samples, len(frames))).round().astype(int)
    return np.median(np.stack([frames[k] for k in picked]), axis=0).astype(np.uint8)


def same_person(cameras: Cameras, candidates: list[np.ndarray]) -> np.ndarray:
    """One box per camera [camera,4] of those in `candidates` (list over cameras of [n,4]) that show one thing in space.

    Each pair of boxes in two views gives a point (middles triangulated); every other view adds its candidate nearest to that point's
    image if it is within a quarter of the box's diagonal. The set seen by most views wins, among equals the one that fits best. Cameras
    without a fitting candidate get NaN.
    """
    best, best_rank = np.tile(NOWHERE, (len(cameras), 1)), (0, np.inf)
    for a, b in combinations(range(len(cameras)), 2):
        for box_a, box_b in product(candidates[a], candidates[b]):
            boxes = np.tile(NOWHERE, (len(cameras), 1))
            boxes[a], boxes[b] = box_a, box_b
            chosen, misfit = _gathered(cameras, candidates, boxes)
            rank = (-int(np.isfinite(chosen[:, 0]).sum()), misfit)
            if rank < best_rank:
                best, best_rank = chosen, rank
    return best


def _gathered(cameras: Cameras, candidates: list[np.ndarray], pair: np.ndarray) -> tuple[np.ndarray, float]:
    x = _middle_in_space(cameras, pair)
    uv, depth = project(cameras, x[None])
    chosen, misfits = np.tile(NOWHERE, (len(cameras), 1)), []
    for camera, boxes in enumerate(candidates):
        if len(boxes) and depth[camera, 0] > 0 and np.isfinite(uv[camera, 0]).all():
            middle, diagonal = (boxes[:, :2] + boxes[:, 2:]) / 2, np.linalg.norm(boxes[:, 2:] - boxes[:, :2], axis=1)
            misfit = np.linalg.norm(middle - uv[camera, 0], axis=1) / diagonal
            if misfit.min() < 0.25:
                chosen[camera] = boxes[misfit.argmin()]
                misfits.append(misfit.min())
    return chosen, float(np.mean(misfits)) if len(misfits) >= 2 else np.inf


def _middle_in_space(cameras: Cameras, boxes: np.ndarray) -> np.ndarray:
    middle = (boxes[:, None, :2] + boxes[:, None, 2:]) / 2
    return triangulate(cameras, middle, np.isfinite(middle).all(-1).astype(float))[0][0]
