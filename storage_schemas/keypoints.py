"""Keypoints: where a detector sees the 133 points of COCO-WholeBody, per frame and camera.

* Pixels of the image as recorded, lens distortion included, in the convention of the capture (first centre at 0.5, 0.5).
* Order MUST be COCO-WholeBody: 17 body, 6 feet, 68 face, 21 left hand, 21 right hand.
* `score` MUST be finite and not negative; 0 means not seen, and the point may then be NaN. It need not stop at 1:
  detectors that read a heat map give its height.
* `boxes` is x0, y0, x1, y1 of the person; NaN where nobody was found.
* `detector_sha256` is that of the model's file.
"""

from __future__ import annotations

import numpy as np

from storage_schemas.faults import Fault
from storage_schemas.fields import array, names
from storage_schemas.record import Record


class Keypoints(Record, name="keypoints", version=1):
    """Detections in images; nothing is known yet about depth."""

    keypoints: np.ndarray = array("frame camera 133 2", "float32", "px")
    score: np.ndarray = array("frame camera 133", "float32", "1")
    boxes: np.ndarray = array("frame camera 4", "float32", "px")
    camera_names: tuple[str, ...] = names("camera")
    detector: str
    detector_sha256: str

    def faults(self) -> list[Fault]:
        """Scores, and points that claim to be seen."""
        found = []
        if not (np.isfinite(self.score) & (self.score >= 0)).all():
            found.append(self.fault("score", "holds NaN, infinity or a negative number", "give 0 where nothing was seen"))
        if (np.isnan(self.keypoints).any(-1) & (self.score > 0)).any():
            found.append(self.fault("keypoints", "is NaN where the score is above 0", "give score 0 there"))
        return found
