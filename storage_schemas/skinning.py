"""Skinning: how the tracked surface hangs on the body's 55 joints.

* `weights` MUST be non-negative and sum to 1 over the joints, for every vertex of the tracked surface.
* `matched` tells where they were read off the body; elsewhere they were filled in from the matched neighbourhood.
* `unmatched_pieces` lists connected pieces without any match and what was done about them.
* `rest_vertices` is the surface in the body's rest pose.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from storage_schemas.faults import Fault
from storage_schemas.fields import JsonList, array
from storage_schemas.record import Record

SUM_TO = 1e-4  # float32 sums of 55 terms


class Skinning(Record, name="skinning", version=1):
    """Skin weights of the tracked surface, and its rest shape."""

    weights: np.ndarray = array("vertex 55", "float32", "1")
    matched: np.ndarray = array("vertex", "bool", "1")
    rest_vertices: np.ndarray = array("vertex 3", "float32", "m")
    unmatched_pieces: JsonList = Field(default_factory=list)

    def faults(self) -> list[Fault]:
        """Weights."""
        return weight_faults(self, self.weights)


def weight_faults(record: Record, weights: np.ndarray) -> list[Fault]:
    """Rows of `weights` [vertex, joint] that are no convex combination."""
    wrong = np.flatnonzero(~((weights >= 0).all(axis=1) & (np.abs(weights.sum(axis=1) - 1) < SUM_TO)))
    if not wrong.size:
        return []
    what = f"of {wrong.size} vertices (first {wrong[0]}, sum {weights[wrong[0]].sum():.6g}) are negative or do not sum to 1"
    return [record.fault("weights", what, "clip and divide by the sum")]
