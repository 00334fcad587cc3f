"""A body that starts centimetres off comes back to the skin it was sampled from, hidden parts with it; without skin it stays."""

import numpy as np
import pytest

from tasks.geometry.meshes import vertex_normals
from tasks.registration.register import FEWEST, Pose, Skin, register
from tasks.registration.skin_distance import FARTHEST, SkinDistance, matched
from tests.body.actors import actor
from tests.simulator.scenes import sheet

FRAMES, NOISE = 3, 2e-3
TRUNK = (0, 1, 2, 3, 6, 9)  # joints whose skin a dress hides


@pytest.fixture(scope="module")
def dancer(model):
    """An actor in a dress: the truth, what keypoints made of it, and her tracked skin."""
    truth, rng = actor(model, FRAMES, seed=4), np.random.default_rng(4)
    pose = truth.pose.copy()
    pose[:, :22] += rng.normal(0, 0.02, (22, 3))  # a detector errs alike in all frames
    start = Pose(pose, truth.shape + rng.normal(0, 1.0, 10), np.zeros((FRAMES, 10)), truth.translation + rng.normal(0, 0.015, 3))
    bare = model.skin & (model.weights[:, TRUNK].sum(1) < 0.3)
    seen = np.tile(bare, (FRAMES, 1)) & (rng.uniform(size=(FRAMES, len(bare))) < 0.8)
    tracked = truth.posed.vertices + NOISE * rng.standard_normal(truth.posed.vertices.shape)
    return truth, start, Skin(np.where(seen[..., None], tracked, np.nan), model.faces, np.flatnonzero(bare), seen)


def errors_mm(model, truth, found):
    """Mean joint error and rms vertex error."""
    posed = model.pose(found.shape, found.expression, found.pose, found.translation)
    joints = np.linalg.norm((posed.joints - truth.posed.joints)[:, :22], axis=-1).mean()
    return 1e3 * joints, 1e3 * np.sqrt(np.mean(np.sum((posed.vertices - truth.posed.vertices) ** 2, -1)))


def test_skin_brings_the_body_back_though_the_trunk_is_hidden(model, dancer):
    truth, start, skin = dancer
    found = register(model, start, skin)
    before, after = errors_mm(model, truth, start), errors_mm(model, truth, found.found)
    assert before[0] > 15
    assert after[0] < 0.4 * before[0] and after[1] < 0.5 * before[1], (before, after)
    assert (found.distance[:, 1] < 0.3 * found.distance[:, 0]).all(), found.distance
    assert "mm from the body" in found.ending


def test_without_skin_it_stays_as_keypoints_had_it(model, dancer):
    _, start, skin = dancer
    few = Skin(skin.vertices, skin.faces, skin.index[: FEWEST // 2], skin.seen)
    found = register(model, start, few)
    assert found.found is start and np.isnan(found.distance).all() and "too little skin" in found.ending


def test_frames_without_skin_keep_their_pose(model, dancer):
    _, start, skin = dancer
    seen = skin.seen.copy()
    seen[1] = False
    found = register(model, start, Skin(skin.vertices, skin.faces, skin.index, seen))
    np.testing.assert_allclose(found.found.pose[1, :22], start.pose[1, :22], atol=1e-9)
    assert np.isnan(found.distance[1]).all() and np.isfinite(found.distance[2]).all()


def test_the_slope_is_that_of_the_energy_and_the_curvature_never_negative():
    rng = np.random.default_rng(0)
    normal = rng.standard_normal((7, 3))
    term = SkinDistance(rng.standard_normal((7, 3)) * 0.02, normal / np.linalg.norm(normal, axis=1, keepdims=True))
    p, direction, e = rng.standard_normal((7, 3)) * 0.02, rng.standard_normal((7, 3)), 1e-6
    _, gradient, curvature = term.expand(p)
    slope = (term.energy(p + e * direction) - term.energy(p - e * direction)) / (2 * e)
    assert np.sum(gradient * direction) == pytest.approx(slope, rel=1e-6)
    assert np.linalg.eigvalsh(curvature).min() > 0


def test_only_what_is_near_and_faces_the_same_way_is_matched():
    x, faces = sheet(6, 6, length=0.4, width=0.4)
    n = vertex_normals(x, faces)
    for skin, normal, kept in ((x + 1e-3 * n, n, len(x)), (x + 1e-3 * n, -n, 0), (x + 2 * FARTHEST * n, n, 0)):
        assert len(matched(skin, normal, x, faces).skin) == kept
