from dataclasses import replace

import numpy as np
import pytest

from tasks.body.keypoint_body import keypoint_body
from tasks.body.wholebody import keypoints133

STEP = 1e-6


@pytest.fixture(scope="module")
def at():
    rng = np.random.default_rng(3)
    return rng.normal(size=20), rng.normal(0, 0.5, (55, 3)), rng.normal(size=3)


@pytest.fixture(scope="module")
def corrected(model):
    """With pose correctives, as licensed files have."""
    return replace(model, pose_directions=np.random.default_rng(1).normal(0, 1e-3, (len(model.template), 3, 486)))


@pytest.mark.parametrize("which", ["model", "corrected"])
def test_keypoints_are_those_of_the_whole_body(request, which, at):
    model = request.getfixturevalue(which)
    coefficients, pose, translation = at
    posed = model.pose(coefficients[:10], coefficients[10:], pose, translation)
    assert np.abs(keypoint_body(model).at(*at).p - keypoints133(model, posed.vertices, posed.joints)).max() < 1e-9


def test_derivative_by_pose_is_the_finite_difference(model, at):
    body, (coefficients, pose, translation) = keypoint_body(model), at
    found = body.at(*at).by_pose()
    for i in range(0, 165, 7):
        step = np.zeros(165)
        step[i] = STEP
        ahead, behind = (body.at(coefficients, pose + sign * step.reshape(55, 3), translation).p for sign in (1, -1))
        assert np.abs((ahead - behind) / (2 * STEP) - found[:, :, i]).max() < 1e-7


def test_derivative_by_shape_is_the_finite_difference(model, at):
    body, (coefficients, pose, translation) = keypoint_body(model), at
    found = body.at(*at).by_shape()
    for i, unit in enumerate(np.eye(20)):
        ahead, behind = (body.at(coefficients + sign * STEP * unit, pose, translation).p for sign in (1, -1))
        assert np.abs((ahead - behind) / (2 * STEP) - found[:, :, i]).max() < 1e-7


def test_a_shape_built_in_is_the_shape_given(model, at):
    body, (coefficients, pose, translation) = keypoint_body(model), at
    built_in = body.shaped(np.append(coefficients[:10], np.zeros(10)), slice(10, 20))
    assert np.abs(built_in.at(coefficients[10:], pose, translation).p - body.at(*at).p).max() < 1e-12
    assert np.abs(built_in.at(coefficients[10:], pose, translation).by_shape() - body.at(*at).by_shape()[..., 10:]).max() < 1e-12
