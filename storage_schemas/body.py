"""Body: the parametric body that follows the actor, in the SMPL-X layout of 55 joints.

* `pose` is axis-angle per joint relative to its parent, in the SMPL-X order; `shape` and `expression` are coefficients of
  the model's own spaces. vertices = scale · LBS(pose, shape, expression) + translation.
* `transforms` take the rest pose to the frame: vertex = Σⱼ weightⱼ · transformⱼ · (rest vertex, 1). Their last row MUST
  be 0 0 0 1; rotation part without unit, last column in metres.
* `weights` MUST be non-negative and sum to 1 over the joints.
* `reprojection_px` is the distance from each detected keypoint to the model's; NaN where it was not detected.
* `model_sha256` is that of the body model's file, or of what the demo body is made from; `ending` tells in one sentence how the fit ended.
"""

from __future__ import annotations

import numpy as np

from storage_schemas.faults import Fault
from storage_schemas.fields import array
from storage_schemas.record import Record
from storage_schemas.skinning import weight_faults


class Body(Record, name="body", version=1):
    """Shape and motion of the body under the clothes."""

    pose: np.ndarray = array("frame 55 3", "float32", "rad")
    shape: np.ndarray = array("shape", "float32", "1")
    expression: np.ndarray = array("frame expression", "float32", "1")
    translation: np.ndarray = array("frame 3", "float32", "m")
    vertices: np.ndarray = array("frame body_vertex 3", "float32", "m")
    joints: np.ndarray = array("frame 55 3", "float32", "m")
    transforms: np.ndarray = array("frame 55 4 4", "float32", "m")
    faces: np.ndarray = array("body_face 3", "int32", "body_vertex index")
    weights: np.ndarray = array("body_vertex 55", "float32", "1")
    reprojection_px: np.ndarray = array("frame camera point", "float32", "px")
    scale: float
    model: str
    model_sha256: str
    ending: str

    def faults(self) -> list[Fault]:
        """Weights, last rows, scale, and numbers that must be finite."""
        found = weight_faults(self, self.weights)
        if not np.array_equal(self.transforms[..., 3, :], np.broadcast_to([0, 0, 0, 1], (*self.transforms.shape[:-2], 4))):
            found.append(self.fault("transforms", "have a last row other than 0 0 0 1", "give affine transforms"))
        if self.scale <= 0:
            found.append(self.fault("scale", f"is {self.scale}", "give a positive number"))
        not_finite = [field for field in ("pose", "translation", "vertices", "joints") if not np.isfinite(getattr(self, field)).all()]
        return found + [self.fault(field, "holds NaN or infinity", "a body is known in every frame") for field in not_finite]
