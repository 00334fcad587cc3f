"""Skin carried by a two-bone body: rigid where the body is, nothing for cloth."""

import numpy as np
import pytest

from tasks.geometry.rotations import matrix_from_axis_angle
from tasks.tracking.body_motion import carried_by_body, skin_vertices
from tests.tracking.skirt import cone


@pytest.fixture
def body():
    """A cone as body: the upper half moves with joint 0, which stays, the lower with joint 1, which turns and shifts."""
    vertices, faces = cone(16, 11)
    weights = np.zeros((len(vertices), 2))
    weights[:, 0] = np.clip((vertices[:, 1] - 0.5) / 0.2 + 0.5, 0, 1)
    weights[:, 1] = 1 - weights[:, 0]
    transforms = np.tile(np.eye(4), (3, 2, 1, 1))
    transforms[:, :, :3, :3] = matrix_from_axis_angle(np.array([0.0, 0.4, 0.0]))  # frame 0 is not the rest pose
    for t in (1, 2):
        transforms[t, 1, :3, :3] = matrix_from_axis_angle(np.array([0.0, 0.4 + 0.2 * t, 0.1]))
        transforms[t, 1, :3, 3] = [0.1 * t, 0, 0]
    return vertices, faces, weights, transforms


def test_frame_0_is_the_template_and_rigid_parts_move_rigidly(body):
    vertices, faces, weights, transforms = body
    skin = vertices * [1.02, 1.0, 1.02]
    found = carried_by_body(skin, np.ones(len(skin), bool), vertices, faces, weights=weights, transforms=transforms)
    assert found[0] == pytest.approx(skin, abs=1e-12)
    lower = skin[:, 1] < 0.3
    move = transforms[2, 1] @ np.linalg.inv(transforms[0, 1])
    assert found[2][lower] == pytest.approx(skin[lower] @ move[:3, :3].T + move[:3, 3], abs=1e-12)
    assert found[2][skin[:, 1] > 0.7] == pytest.approx(skin[skin[:, 1] > 0.7], abs=1e-12)


def test_cloth_has_no_prediction(body):
    vertices, faces, weights, transforms = body
    part = np.where(np.arange(len(faces)) < 100, "body", "skirt")
    skin = skin_vertices(faces, part, len(vertices))
    assert not skin[faces[100:]].any() and skin.any()
    found = carried_by_body(vertices, skin, vertices, faces, weights=weights, transforms=transforms)
    assert np.isnan(found[:, ~skin]).all() and np.isfinite(found[:, skin]).all()
    assert np.isnan(carried_by_body(vertices, np.zeros_like(skin), vertices, faces, weights=weights, transforms=transforms)).all()
