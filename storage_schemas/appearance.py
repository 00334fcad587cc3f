"""Appearance: the colour of the surface and the light it was recorded in.

* `albedo` is linear (not sRGB), in the texture space of the tracked surface, row 0 at v = 1; `observed` marks texels that
  some camera saw, the others were filled in.
* `light` is linear RGB; `gains` multiply a render per camera and channel.
* `psnr` compares renders with the images of `training_frames`, in cameras kept out of the fit too; NaN where a pair was not compared.
  Which camera was kept out is a parameter of the stage and stands in the provenance.
"""

from __future__ import annotations

import numpy as np

from storage_schemas.fields import array
from storage_schemas.record import Record


class Appearance(Record, name="appearance", version=1):
    """Texture, light and cameras' gains."""

    albedo: np.ndarray = array("row column 3", "float32", "1")
    observed: np.ndarray = array("row column", "bool", "1")
    light: np.ndarray = array("3", "float32", "1")
    psnr: np.ndarray = array("frame_used camera", "float32", "dB")
    gains: np.ndarray = array("camera 3", "float32", "1")
    training_frames: tuple[int, ...]
