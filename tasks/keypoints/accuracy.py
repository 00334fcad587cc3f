"""How good keypoints are: the share within a fraction of the person's box, and the median error.

    PCK@a = share of keypoints with |u − u*| < a · max(box width, box height)

Yang & Ramanan (2013), on visible keypoints; the box is that of all true keypoints. Limit: says nothing about scores.
"""

from __future__ import annotations

import numpy as np

GROUPS = {
    "body": np.arange(17),
    "wrists": np.array([9, 10]),
    "feet": np.arange(17, 23),
    "face": np.arange(23, 91),
    "hands": np.arange(91, 133),
}


def pck(found: np.ndarray, truth: np.ndarray, counted: np.ndarray, *, within: float) -> float:
    """Share of `counted` [person,point] keypoints whose `found` lies within `within` box sizes of `truth`, both [person,point,2] px."""
    size = np.ptp(truth, axis=1).max(-1)
    near = np.linalg.norm(found - truth, axis=-1) < within * size[:, None]
    return float(near[counted].mean())


def group_table(found: np.ndarray, truth: np.ndarray, counted: np.ndarray) -> dict[str, dict[str, float]]:
    """Per group of keypoints with any counted: PCK@0.05, PCK@0.1, median error [px], and how many were counted; [person,133,2] px each."""
    error = np.linalg.norm(found - truth, axis=-1)
    table = {}
    for name, points in GROUPS.items():
        part = counted[:, points]
        everywhere = np.zeros_like(counted)
        everywhere[:, points] = part
        if not part.any():
            continue
        table[name] = {
            "pck05": pck(found, truth, everywhere, within=0.05),
            "pck10": pck(found, truth, everywhere, within=0.1),
            "median_px": float(np.median(error[everywhere])),
            "count": int(part.sum()),
        }
    return table
