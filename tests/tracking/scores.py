"""What the tests and the benchmark measure against the true skirt."""

import numpy as np

from tasks.geometry.meshes import face_normals
from tasks.tracking.sequence import track_sequence
from tasks.tracking.settings import Settings


def track(s, *, frames=None, **settings):
    """Track a synthetic set with these settings."""
    frames = len(s.images) if frames is None else frames
    return track_sequence(s.image, s.mask, s.cameras, s.vertices[0], s.faces, frames=frames, settings=Settings(**settings))


def rmse(x, truth):
    """Root mean square distance [m]."""
    return float(np.sqrt(((x - truth) ** 2).sum(-1).mean()))


def normal_error(x, truth, faces):
    """Mean angle between face normals [degrees]."""
    cosine = (face_normals(x, faces) * face_normals(truth, faces)).sum(-1)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean())
