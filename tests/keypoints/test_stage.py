"""The door of keypoints: what it says of a recording in which nobody moves."""

from types import SimpleNamespace

import numpy as np
import pytest

from tasks.geometry.faults import BadInput
from tasks.keypoints.detector import Detections
from tasks.keypoints.stage import _follow
from tests.keypoints.test_person_box import rig  # noqa: F401


class Blind:
    """Finds nothing."""

    def detect(self, images, *, boxes, refine):
        return Detections(np.full((len(images), 133, 2), np.nan), np.zeros((len(images), 133)), boxes)


def test_a_recording_in_which_nobody_moves_is_named(rig):  # noqa: F811
    room = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
    recording = SimpleNamespace(root="data/bob/one", cameras=rig, frames=range(3), mask=None, read_rgb=lambda camera, frame: room)
    job = SimpleNamespace(progress=lambda fraction, text: None)
    with pytest.raises(BadInput, match=r"data/bob/one: in no frame does anybody move.*keypoints\.file"):
        _follow(Blind(), recording, job)
