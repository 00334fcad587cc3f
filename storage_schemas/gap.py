"""Gap: where the simulation departs from the recording, and what the diagnosis says.

* `residual` is observed minus simulated, `residual_mm` its length; NaN where the vertex was not observed.
* `zone_of_vertex` indexes `zone_names` (contact, free, hem, seam, pin).
* `tables` hold the residual per zone, direction and frequency band; `floor_mm` is the noise of the observation itself.
* `verdict` is the JSON that `physavatar gap run --json` prints; None where something is unseen.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from storage_schemas.fields import JsonDict, array, names
from storage_schemas.record import Record


class Gap(Record, name="gap", version=1):
    """The sim-to-real gap of one recording."""

    residual: np.ndarray = array("frame vertex 3", "float32", "m")
    residual_mm: np.ndarray = array("frame vertex", "float32", "mm")
    zone_names: tuple[str, ...] = names("zone")
    zone_of_vertex: np.ndarray = array("vertex", "int32", "zone index")
    tables: JsonDict = Field(default_factory=dict)
    floor_mm: float | None
    verdict: JsonDict
