"""Registration: the body as `body.py` describes it, once its surface lies where skin was tracked.

* Everything is as in Body; where too little skin was tracked, it is the Body of the keypoints, and `ending` says so.
* `distance_m` is the median distance of matched skin from the body, before and after; NaN in frames where too little was seen.
"""

from __future__ import annotations

import numpy as np

from storage_schemas.body import Body
from storage_schemas.fields import array


class Registration(Body, name="registration", version=1):
    """Shape and motion of the body under the clothes, registered to tracked skin."""

    distance_m: np.ndarray = array("frame 2", "float32", "m")
