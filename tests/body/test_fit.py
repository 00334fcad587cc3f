"""Fits against motions that are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from tasks.body.fit import fit_sequence
from tasks.body.objective import FitWeights, Objective
from tasks.body.wholebody import keypoints133
from tasks.geometry.cameras import project
from tasks.geometry.faults import BadInput
from tests.body.actors import actor, detections, ring


def joint_errors(motion, truth) -> np.ndarray:
    return np.linalg.norm(motion.joints - truth.posed.joints, axis=-1) * 1000


@pytest.mark.parametrize(("seed", "cameras", "turn"), [(0, 8, 1.0), (1, 8, 3.0), (2, 4, 1.0), (3, 6, 0.0)])
def test_joints_are_found_within_a_centimetre(model, seed, cameras, turn):
    """1.5 px of noise (6.6 mm at the actor), one detection in ten anywhere in the image."""
    truth, rig = actor(model, 6, seed=seed, turn=turn), ring(cameras)
    motion = fit_sequence(model, rig, *detections(model, rig, truth.posed, seed=seed))
    errors = joint_errors(motion, truth)
    assert motion.converged.all()
    assert errors.mean() < 7
    assert errors.mean(axis=1).max() < 10
    assert np.linalg.norm(motion.vertices - truth.posed.vertices, axis=-1).mean() < 0.010


def test_without_noise_only_the_priors_are_left(model):
    truth, rig = actor(model, 3, seed=5), ring(8)
    motion = fit_sequence(model, rig, *detections(model, rig, truth.posed, seed=5, noise=0, wrong=0))
    errors = joint_errors(motion, truth)
    assert errors[:, [1, 2, 4, 5, 7, 8, 16, 17, 18, 19, 20, 21]].mean() < 2  # limbs
    assert errors.mean() < 4  # the spine bends by a rest pose, not by what is seen
    assert np.median(motion.reprojection_px) < 0.5


def test_shuffled_cameras_are_no_fit(model):
    truth, rig = actor(model, 3, seed=0), ring(8)
    uv, score = detections(model, rig, truth.posed, seed=0)
    order = np.random.default_rng(0).permutation(8)
    motion = fit_sequence(model, rig, uv[:, order], score[:, order])
    assert joint_errors(motion, truth).mean() > 100
    assert np.median(motion.reprojection_px) > 20


@pytest.fixture(scope="module")
def one_frame(model):
    """Truth, rig and detections of one frame, and the fit with the shape known."""
    truth, rig = actor(model, 1, seed=7), ring(4)
    uv, score = detections(model, rig, truth.posed, seed=7)
    motion = fit_sequence(model, rig, uv, score, shape=truth.shape)
    objective = Objective.of(model, FitWeights()).frozen(truth.shape)
    z = objective.start(motion.pose[0], motion.translation[0])
    for side, first in ((0, 25), (1, 40)):
        flat = motion.pose[0, first : first + 15].ravel() - model.hand_mean[side]
        z[69 + 12 * side : 81 + 12 * side] = model.hand_components[side, :12] @ flat
    np.testing.assert_allclose(objective.unknowns(motion.pose[0], motion.translation[0]), z, atol=1e-9)
    return truth, rig, uv[0], score[0], objective, z


def test_energy_is_that_of_equations_2_and_3(model, one_frame):
    """The slow obvious way: by posing the whole body."""
    truth, rig, uv, score, objective, found = one_frame
    z = found + np.random.default_rng(0).normal(0, 0.1, len(found))
    pose = np.zeros((55, 3))
    pose[:22] = z[3:69].reshape(22, 3)
    for side, first in ((0, 25), (1, 40)):
        hand = z[69 + 12 * side : 81 + 12 * side] @ model.hand_components[side, :12]
        pose[first : first + 15] = (model.hand_mean[side] + hand).reshape(15, 3)
    posed = model.pose(truth.shape, np.zeros(10), pose, z[:3])
    e = np.linalg.norm(project(rig, keypoints133(model, posed.vertices, posed.joints))[0] - uv, axis=-1) * 1000 / 512
    d = np.sqrt(1 + e**2 * 100**2 / (100**2 + e**2)) - 1
    counted = [*range(23), *range(91, 133)]
    data = 1e-3 * 160 / 4 * (score * d)[:, counted].sum()
    expected = data + 0.3 * (z[6:69] ** 2).sum() + 1.0 * (z[69:93] ** 2).sum()
    assert objective.energy(objective.sight(rig, uv, score), z) == pytest.approx(expected, rel=1e-9)


def test_gradient_is_the_finite_difference(model, one_frame):
    _, rig, uv, score, _, found = one_frame
    objective, rng = Objective.of(model, replace(FitWeights(), face=1e-3)), np.random.default_rng(1)
    sight = objective.sight(rig, uv, score)
    shape, z = rng.normal(size=10), np.append(found, np.zeros(13)) + rng.normal(0, 0.1, len(found) + 13)
    u, gradient = np.append(shape, z), objective.expand(sight, z, shape)[1]
    for i in range(0, len(u), 5):
        ahead, behind = (u + sign * 1e-6 * np.eye(len(u))[i] for sign in (1, -1))
        slope = (objective.energy(sight, ahead[10:], ahead[:10]) - objective.energy(sight, behind[10:], behind[:10])) / 2e-6
        assert slope == pytest.approx(gradient[i], rel=1e-4, abs=1e-4)


@pytest.mark.slow
def test_minimum_is_scipys(one_frame):
    """Finite differences from a start nearby, on the energy that the test above holds to the obvious one."""
    _, rig, uv, score, objective, found = one_frame
    sight = objective.sight(rig, uv, score)
    start = found + np.random.default_rng(0).normal(0, 0.02, len(found))
    slow = minimize(lambda z: objective.energy(sight, z), start, method="L-BFGS-B", options={"maxiter": 400, "maxfun": 60000})
    assert objective.energy(sight, found) <= slow.fun * (1 + 1e-4)
    assert np.linalg.norm(objective.points(slow.x) - objective.points(found), axis=1).mean() < 0.003


def test_face_points_move_jaw_and_expression_only_when_asked(model):
    truth, rig = actor(model, 2, seed=1), ring(8)
    pose = truth.pose.copy()
    pose[:, 22, 0] = 0.25  # jaw open
    posed = model.pose(truth.shape, np.full(10, 0.5), pose, truth.translation)
    seen = detections(model, rig, posed, seed=1, noise=0.2, wrong=0)
    closed, opened = (fit_sequence(model, rig, *seen, weights=replace(FitWeights(), face=face)) for face in (0, 1e-3))
    assert np.abs(closed.pose[:, 22]).max() == 0
    assert np.abs(closed.expression).max() == 0
    assert opened.pose[:, 22, 0] == pytest.approx(0.25, abs=0.1)
    mouth = np.arange(23 + 48, 91)
    assert opened.reprojection_px[:, :, mouth].mean() < 0.3 * closed.reprojection_px[:, :, mouth].mean()


def test_a_frame_in_which_nothing_is_seen_keeps_the_pose_before_and_says_so(model):
    truth, rig = actor(model, 3, seed=2), ring(4)
    uv, score = detections(model, rig, truth.posed, seed=2)
    uv[1] = np.nan
    motion = fit_sequence(model, rig, uv, score)
    assert motion.converged.tolist() == [True, False, True]
    assert "frame 1: nothing was seen" in motion.ending
    assert motion.joints[1] == pytest.approx(motion.joints[0], abs=1e-6)


@pytest.mark.parametrize("cameras_seeing", [0, 1])
def test_the_first_frames_without_two_views_stay_with_the_frames_after(model, cameras_seeing):
    """They would start from the origin; the actor stands 2 m from it."""
    known, rig = actor(model, 4, seed=2), ring(4)
    away = known.translation + np.array([2.0, 0, 0])
    truth, rig = model.pose(known.shape, np.zeros(10), known.pose, away), replace(rig, t=rig.t - rig.R @ [2.0, 0, 0])
    uv, score = detections(model, rig, truth, seed=2)
    uv[:2, cameras_seeing:] = np.nan
    motion = fit_sequence(model, rig, uv, score)
    assert motion.converged[2:].all()
    assert np.linalg.norm(motion.joints - truth.joints, axis=-1)[2:].mean() < 0.01
    assert np.linalg.norm(motion.joints - truth.joints, axis=-1)[:2].mean() < 0.15
    if not cameras_seeing:
        assert not motion.converged[:2].any() and motion.joints[0] == pytest.approx(motion.joints[2], abs=1e-6)


def test_cameras_that_agree_on_nothing_are_refused(model):
    rig = ring(2)
    apart = np.stack([np.full((1, 133, 2), 20.0), np.full((1, 133, 2), [256.0, 490.0])], axis=1)
    with pytest.raises(BadInput, match="no two cameras see a point in the same place"):
        fit_sequence(model, rig, apart, np.ones((1, 2, 133)))


def test_a_jump_between_frames_is_followed(model):
    """Half a turn and 0.8 m from one frame to the next: from the frame before, the descent is not done after 50 steps and 18 mm off."""
    one, rig = actor(model, 2, seed=3, turn=np.pi * 25), ring(8)
    translation = one.translation + np.array([[-0.4, 0, 0], [0.4, 0, 0]])
    truth = replace(one, posed=model.pose(one.shape, np.zeros(10), one.pose, translation))
    motion = fit_sequence(model, rig, *detections(model, rig, truth.posed, seed=3))
    assert motion.converged.all()
    assert joint_errors(motion, truth).mean(axis=1).max() < 10


def test_input_that_does_not_match_the_rig_is_refused(model):
    rig = ring(4)
    with pytest.raises(BadInput, match="Expected"):
        fit_sequence(model, rig, np.zeros((2, 3, 133, 2)), np.zeros((2, 3, 133)))
    with pytest.raises(BadInput, match="no point is seen by two cameras"):
        fit_sequence(model, rig, np.full((2, 4, 133, 2), np.nan), np.ones((2, 4, 133)))
    with pytest.raises(BadInput, match="negative"):
        fit_sequence(model, rig, np.zeros((2, 4, 133, 2)), -np.ones((2, 4, 133)))
