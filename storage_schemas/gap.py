"""Gap: where the simulation departs from the recording, and what the diagnosis says.

* `residual` is observed minus simulated, `residual_mm` its length; NaN where the vertex was not observed.
* `zone_of_vertex` indexes `zone_names` (contact, free, hem, seam, pin).
* `tables` hold the residual per zone, direction and frequency band; `floor_mm` is the noise of the observation itself.
* `verdict` is the JSON that `physavatar gap run --json` prints; None where something is unseen.
* `files` hold what the verdict rests on, as `physavatar gap run --report` writes it: `gap.html`, a page that needs no other file, and
  `gap.json`, every figure in it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import Field

from storage_schemas.fields import JsonDict, array, names, stored_files
from storage_schemas.record import Record

PAGE, NUMBERS = "gap.html", "gap.json"


class Gap(Record, name="gap", version=2):
    """The sim-to-real gap of one recording."""

    residual: np.ndarray = array("frame vertex 3", "float32", "m")
    residual_mm: np.ndarray = array("frame vertex", "float32", "mm")
    zone_names: tuple[str, ...] = names("zone")
    zone_of_vertex: np.ndarray = array("vertex", "int32", "zone index")
    tables: JsonDict = Field(default_factory=dict)
    floor_mm: float | None
    verdict: JsonDict
    files: dict[str, bytes] = stored_files()

    @classmethod
    def migrate(cls, version: int, fields: dict[str, Any]) -> dict[str, Any]:
        """Version 1 did not keep what its verdict rests on."""
        return fields
