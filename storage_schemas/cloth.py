"""Cloth: the garments' estimated fabric and their simulated motion. All garments of one actor in one artifact.

* `vertices_index` MUST be the number, in the tracked surface, of each simulated vertex; `faces` count simulated vertices.
* `boundary` marks vertices whose motion was prescribed.
* `parameters` MUST name only garments of `garment_names`; every estimate has a unit. Without air, motion depends only on
  ratios to the density: what is not identified has no value, and `low` and `high` are then None too. Effects that the model has beside
  the base are parameters too, one per strength and under its name (`air_normal_drag`, `air_wind.w_x`); `simulated` is with them.
* `loss_history`, `timing` [s] and `endings` tell how the estimation went.
* `knowledge` tells, per garment, what bounds the estimates besides their intervals: the gauge, other intervals, what a choice changes.
"""

from __future__ import annotations

from typing import Any, NotRequired

import numpy as np
from pydantic import Field
from typing_extensions import TypedDict  # pydantic reads the one in typing from Python 3.12 on

from storage_schemas.faults import Fault
from storage_schemas.fields import Json, JsonDict, array, names
from storage_schemas.record import Record


class Estimate(TypedDict):
    """A value with its interval and unit; None where the recording does not tell, and `sentence` may say why."""

    value: float | None
    low: float | None
    high: float | None
    unit: str
    sentence: NotRequired[str]


class Cloth(Record, name="cloth", version=2):
    """What the garments are made of, as far as motion tells, and how they then move."""

    garment_names: tuple[str, ...] = names("garment")
    vertices_index: np.ndarray = array("garment_vertex", "int32", "1")
    garment_of_vertex: np.ndarray = array("garment_vertex", "int32", "garment index")
    simulated: np.ndarray = array("frame garment_vertex 3", "float32", "m")
    faces: np.ndarray = array("garment_face 3", "int32", "garment_vertex index")
    boundary: np.ndarray = array("garment_vertex", "bool", "1")
    parameters: dict[str, dict[str, Estimate]]
    loss_history: Json = None
    timing: JsonDict = Field(default_factory=dict)
    endings: tuple[str, ...] = ()
    knowledge: JsonDict = Field(default_factory=dict)

    @classmethod
    def migrate(cls, version: int, fields: dict[str, Any]) -> dict[str, Any]:
        """Version 1 had no `knowledge`."""
        return fields

    def faults(self) -> list[Fault]:
        """Garments that nobody named, and numbers of tracked vertices."""
        unknown = sorted(self.parameters.keys() - set(self.garment_names))
        found = [self.fault("parameters", f"name garment {name!r}", "name only garments of garment_names") for name in unknown]
        if self.vertices_index.size and self.vertices_index.min() < 0:
            found.append(self.fault("vertices_index", "holds a negative number", "give numbers of tracked vertices"))
        return found
