"""Skin carried by a moving body: rigid where the body is, nothing for cloth."""

import numpy as np
import pytest

from tasks.geometry.parts import skin_vertices
from tasks.geometry.rotations import matrix_from_axis_angle
from tasks.tracking.body_motion import carried_by_body
from tests.tracking.skirt import cone


@pytest.fixture
def body():
    """A cone as body, whose lower half turns and shifts while the upper stays:
    vertices [3, B, 3], faces, the motion of the lower half in frame 2.
    """
    vertices, faces = cone(16, 11)
    R, shift = matrix_from_axis_angle(np.array([0.2, 0.4, 0.1])), np.array([0.1, 0, 0.05])
    lower = vertices[:, 1:2] < 0.5
    return np.array([vertices, vertices, np.where(lower, vertices @ R.T + shift, vertices)]), faces, R, shift


def test_frame_0_is_the_template_and_rigid_parts_move_rigidly(body):
    vertices, faces, R, shift = body
    skin = vertices[0] * [1.05, 1.0, 1.05]  # a centimetre or two off the body
    found = carried_by_body(skin, np.ones(len(skin), bool), vertices, faces)
    assert found[0] == pytest.approx(skin, abs=1e-12) and found[1] == pytest.approx(skin, abs=1e-12)
    lower, upper = skin[:, 1] < 0.3, skin[:, 1] > 0.7
    assert found[2][lower] == pytest.approx(skin[lower] @ R.T + shift, abs=1e-12)
    assert found[2][upper] == pytest.approx(skin[upper], abs=1e-12)


def test_cloth_has_no_prediction(body):
    vertices, faces, _, _ = body
    part = np.where(np.arange(len(faces)) < 100, "body", "skirt")
    skin = skin_vertices(faces, part, len(vertices[0]))
    assert not skin[faces[100:]].any() and skin.any()
    found = carried_by_body(vertices[0], skin, vertices, faces)
    assert np.isnan(found[:, ~skin]).all() and np.isfinite(found[:, skin]).all()
    assert np.isnan(carried_by_body(vertices[0], np.zeros_like(skin), vertices, faces)).all()
