"""Skin weights cut down to the few strongest joints per vertex that real-time formats carry."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Influences:
    """joints [V, N] and weights [V, N] (sum 1, strongest first); dropped [V] is the weight that was cut off before renormalising."""

    joints: NDArray
    weights: NDArray
    dropped: NDArray


def strongest(weights: NDArray, count: int) -> Influences:
    """The `count` strongest of weights [V, J] (rows sum to 1); where there are fewer joints, joint 0 with weight 0 fills up."""
    w = np.pad(weights.astype(float), ((0, 0), (0, max(count - weights.shape[1], 0))))
    kept = np.argsort(-w, axis=1, kind="stable")[:, :count]
    w = np.take_along_axis(w, kept, axis=1)
    total = w.sum(axis=1, keepdims=True)
    return Influences(np.where(w > 0, kept, 0), w / total, 1 - total[:, 0])
