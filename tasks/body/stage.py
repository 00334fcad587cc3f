"""The door of body: the parametric body that explains the keypoints of all cameras and frames."""

from typing import Annotated

import numpy as np

from storage_schemas.body import Body
from storage_schemas.capture import Capture
from storage_schemas.keypoints import Keypoints
from tasks.body.anny_body import demo_body, demo_body_digest
from tasks.body.fit import FitWeights, fit_sequence
from tasks.body.model import BodyModel
from tasks.recorded import cameras_of
from tasks.stage import Job, ModelFile, NotNegative, Otherwise, Parameters, content_digest, stage


class BodyParameters(Parameters):
    """model: an SMPL-X file (SMPLX_NEUTRAL.npz); without one the licence-free demo body is used. Weights as in the seed's equations 2 and 3."""

    model: Annotated[ModelFile, Otherwise(demo_body_digest)] = None
    body_weight: NotNegative = 1e-3
    hand_weight: NotNegative = 1e-3
    face_weight: NotNegative = 0.0


@stage("body", version=2, pool="vision", timeout_s=4 * 3600)
def body(job: Job, capture: Capture, keypoints: Keypoints, parameters: BodyParameters) -> Body:
    """Fit shape and motion."""
    path, digest = (demo_body(), demo_body_digest()) if parameters.model is None else (parameters.model, content_digest(parameters.model))
    model = BodyModel.load(path)
    weights = FitWeights(body=parameters.body_weight, hand=parameters.hand_weight, face=parameters.face_weight)
    job.progress(0.02, "shared shape")
    found = fit_sequence(model, cameras_of(capture), keypoints.keypoints.astype(float), keypoints.score.astype(float), weights=weights)
    unsure = capture.frame_numbers[~found.converged]
    if len(unsure):
        job.warn(f"the body did not settle in {len(unsure)} of {len(found.converged)} frames, the first is {unsure[0]}")
    return Body(
        pose=found.pose.astype(np.float32),
        shape=found.shape.astype(np.float32),
        expression=found.expression.astype(np.float32),
        translation=found.translation.astype(np.float32),
        vertices=found.vertices.astype(np.float32),
        joints=found.joints.astype(np.float32),
        transforms=found.transforms.astype(np.float32),
        faces=model.faces,
        weights=model.weights.astype(np.float32),
        reprojection_px=found.reprojection_px.astype(np.float32),
        scale=float(found.scale),
        model=path.name,
        model_sha256=digest,
        ending=found.ending,
    )
