"""The door of registration: the fitted body once more, on the skin that was tracked and the cloth that clings to it."""

import os
from typing import Annotated

import numpy as np

from storage_schemas.body import Body
from storage_schemas.capture import Capture
from storage_schemas.keypoints import Keypoints
from storage_schemas.registration import Registration
from storage_schemas.tracking import Tracking
from tasks.body.anny_body import demo_body, demo_body_digest
from tasks.body.fit import pose_sequence, reprojected
from tasks.body.model import BodyModel
from tasks.geometry.faults import BadInput, Fault
from tasks.geometry.parts import SKIN, skin_vertices
from tasks.recorded import cameras_of
from tasks.registration.register import Pose, Skin, register
from tasks.stage import Job, ModelFile, Otherwise, Parameters, content_digest, stage


class RegistrationParameters(Parameters):
    """model: the SMPL-X file that body was fitted with; the setting body.model is taken where none is given here."""

    model: Annotated[ModelFile, Otherwise(demo_body_digest)] = None


@stage("registration", version=3, pool="tracking", timeout_s=4 * 3600)
def registration(
    job: Job, capture: Capture, keypoints: Keypoints, body: Body, tracking: Tracking, parameters: RegistrationParameters
) -> Registration:
    """Draw the body to tracked skin and clinging cloth."""
    path, digest = (demo_body(), demo_body_digest()) if parameters.model is None else (parameters.model, content_digest(parameters.model))
    if digest != body.model_sha256:
        remedy = "Set registration.model to that file, or install the anny of its name on every machine."
        raise BadInput([Fault(str(path), f"the body was fitted with another model, {body.model}", remedy)])
    model, skin = BodyModel.load(path), _skin(tracking)
    worn = tracking.faces[np.asarray(tracking.part_names)[tracking.part_of_face] != SKIN]
    start = Pose(*(np.asarray(a, float) for a in (body.pose, body.shape, body.expression, body.translation)))
    found = register(model, start, skin, worn, job.progress, at_once=os.cpu_count() or 1)
    posed = pose_sequence(model, found.found.shape, found.found.expression, found.found.pose, found.found.translation)
    pixels = reprojected(model, cameras_of(capture), keypoints.keypoints.astype(float), posed)
    return Registration(
        pose=found.found.pose.astype(np.float32),
        shape=found.found.shape.astype(np.float32),
        expression=body.expression,
        translation=found.found.translation.astype(np.float32),
        vertices=posed.vertices.astype(np.float32),
        joints=posed.joints.astype(np.float32),
        transforms=posed.transforms.astype(np.float32),
        faces=body.faces,
        weights=body.weights,
        reprojection_px=pixels.astype(np.float32),
        scale=body.scale,
        model=body.model,
        model_sha256=body.model_sha256,
        ending=found.ending,
        distance_m=found.distance.astype(np.float32),
    )


def _skin(tracking: Tracking) -> Skin:
    """The vertices of the skin that no garment shares; none where the surface is one piece, for it wears its clothes then."""
    part = np.asarray(tracking.part_names)[tracking.part_of_face]
    bare = np.flatnonzero(skin_vertices(tracking.faces, part, tracking.vertices.shape[1]))
    return Skin(tracking.vertices.astype(float), tracking.faces, bare if (part != SKIN).any() else bare[:0], tracking.seen)
