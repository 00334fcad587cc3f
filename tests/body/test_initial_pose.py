import numpy as np
import pytest

from tasks.body.initial_pose import initial_pose, robust_points
from tasks.body.keypoint_body import keypoint_body
from tasks.body.skeleton import JOINT
from tasks.body.wholebody import BODY_AND_FEET, keypoints133
from tasks.geometry.rotations import matrix_from_axis_angle
from tests.body.actors import actor, detections, ring


@pytest.fixture(scope="module")
def rest(model):
    body = keypoint_body(model)
    return body.at(np.zeros(20), np.zeros((55, 3)), np.zeros(3)).p, body.joints


def test_points_survive_a_third_of_wrong_detections(model):
    one, cameras = actor(model, 1, seed=0), ring(8)
    uv, score = detections(model, cameras, one.posed, seed=0, wrong=0.33)
    away = np.linalg.norm(robust_points(cameras, uv[0], score[0]) - keypoints133(model, one.posed.vertices, one.posed.joints)[0], axis=1)
    assert np.median(away) < 0.006
    assert (away < 0.03).mean() > 0.95


def test_a_point_of_one_camera_is_no_point(model):
    one, cameras = actor(model, 1, seed=0), ring(8)
    uv, score = detections(model, cameras, one.posed, seed=0)
    score[0, 1:, 9] = 0
    assert np.isnan(robust_points(cameras, uv[0], score[0])[9]).all()


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("heading", [0, 1.6, 3.1, -2.0])
def test_it_faces_the_right_way_and_reaches_the_keypoints(model, rest, seed, heading):
    one = actor(model, 1, seed=seed)
    pose = one.pose[0].copy()
    pose[0] = [0, heading, 0]
    seen = keypoint_body(model).at(np.append(one.shape, np.zeros(10)), pose, one.translation[0]).p
    found, translation = initial_pose(*rest, seen)
    forward = matrix_from_axis_angle(found[0])[:, 2]
    assert forward @ [np.sin(heading), 0, np.cos(heading)] > 0.9
    reached = keypoint_body(model).at(np.append(one.shape, np.zeros(10)), found, translation).p
    assert np.linalg.norm((reached - seen)[BODY_AND_FEET], axis=1).mean() < 0.05


def test_a_bent_elbow_bends_about_its_hinge(model, rest):
    pose = np.zeros((55, 3))
    pose[JOINT["left_shoulder"], 2] = -1.2
    pose[JOINT["left_elbow"], 1] = -1.4
    found, _ = initial_pose(*rest, keypoint_body(model).at(np.zeros(20), pose, np.zeros(3)).p)
    assert found[JOINT["left_elbow"]] == pytest.approx([0, -1.4, 0], abs=0.1)
    assert found[JOINT["left_shoulder"]] == pytest.approx([0, 0, -1.2], abs=0.1)


def test_unseen_limbs_rest(model, rest):
    seen = keypoint_body(model).at(np.zeros(20), np.zeros((55, 3)), np.array([1.0, 2, 3])).p
    seen[[7, 9]] = np.nan  # left elbow and wrist
    seen[91:112] = np.nan
    found, translation = initial_pose(*rest, seen)
    assert np.abs(found[[JOINT["left_shoulder"], JOINT["left_elbow"], JOINT["left_wrist"]]]).max() < 1e-6
    assert translation == pytest.approx([1, 2, 3], abs=1e-6)
    assert initial_pose(*rest, np.full((133, 3), np.nan))[1] == pytest.approx([0, 0, 0])
