"""The door of skinning: weights for the tracked surface from the body at the first frame, and its shape in the rest pose."""

import numpy as np
from pydantic import Field

from storage_schemas.registration import Registration
from storage_schemas.skinning import Skinning
from storage_schemas.tracking import Tracking
from tasks.skinning.linear_blend import unpose
from tasks.skinning.weight_transfer import transfer_weights
from tasks.stage import Job, Parameters, stage


class SkinningParameters(Parameters):
    """Limits of a match (Abdrashitov et al. 2023): distance as a share of the bounding box's diagonal, angle between normals in degrees."""

    distance: float = Field(default=0.05, gt=0, le=1)
    angle_deg: float = Field(default=30.0, gt=0, le=180)


@stage("skinning", version=1, pool="tracking", timeout_s=3600)
def skinning(job: Job, body: Registration, tracking: Tracking, parameters: SkinningParameters) -> Skinning:
    """Transfer, inpaint, un-pose."""
    surface = tracking.vertices[0].astype(float)
    skin = transfer_weights(
        body.vertices[0].astype(float),
        body.faces,
        body.weights.astype(float),
        surface,
        tracking.faces,
        distance=parameters.distance,
        angle=np.deg2rad(parameters.angle_deg),
    )
    if skin.unmatched_pieces:
        job.warn(skin.ending)
    rest = unpose(surface, skin.weights, body.transforms[0].astype(float))
    return Skinning(
        weights=skin.weights.astype(np.float32),
        matched=skin.matched,
        rest_vertices=rest.x_rest.astype(np.float32),
        unmatched_pieces=[len(piece) for piece in skin.unmatched_pieces],
    )
