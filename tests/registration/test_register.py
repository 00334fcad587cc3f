"""A body that starts centimetres off comes back to the skin it was sampled from, hidden parts with it; without skin it stays.

What a dress hides comes nearer still where a close-fitting top and a waistband show it, and no worse for a skirt that swings off.
"""

from dataclasses import replace

import numpy as np
import pytest

from tasks.geometry.meshes import boundary_edges, vertex_normals
from tasks.registration.clinging_cloth import LOOP, clinging
from tasks.registration.register import FEWEST, Pose, Skin, register
from tasks.registration.skin_distance import FARTHEST, SkinDistance, Together, matched
from tests.body.actors import actor
from tests.simulator.scenes import sheet

FRAMES, NOISE = 3, 2e-3
NAKED = np.zeros((0, 3), np.int32)  # faces of garments
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
    found = register(model, start, skin, NAKED)
    before, after = errors_mm(model, truth, start), errors_mm(model, truth, found.found)
    assert before[0] > 15
    assert after[0] < 0.4 * before[0] and after[1] < 0.5 * before[1], (before, after)
    assert (found.distance[:, 1] < 0.3 * found.distance[:, 0]).all(), found.distance
    assert "mm from the body" in found.ending


def test_without_skin_it_stays_as_keypoints_had_it(model, dancer):
    _, start, skin = dancer
    few = Skin(skin.vertices, skin.faces, skin.index[: FEWEST // 2], skin.seen)
    found = register(model, start, few, NAKED)
    assert found.found is start and np.isnan(found.distance).all() and "too little skin" in found.ending


def test_frames_without_skin_keep_their_pose(model, dancer):
    _, start, skin = dancer
    seen = skin.seen.copy()
    seen[1] = False
    found = register(model, start, Skin(skin.vertices, skin.faces, skin.index, seen), NAKED)
    np.testing.assert_allclose(found.found.pose[1, :22], start.pose[1, :22], atol=1e-9)
    assert np.isnan(found.distance[1]).all() and np.isfinite(found.distance[2]).all()


def test_clinging_cloth_shows_the_trunk_that_it_hides(model, dancer):
    """The scan of the first frame has the skin under the dress, which lies 2 mm over it and slides by 5 mm; or its lower half swings off by
    6 cm.
    """
    truth, start, _ = dancer
    astray = replace(start, pose=start.pose.copy())
    astray.pose[:, :22] += np.random.default_rng(1).normal(0, 0.03, (FRAMES, 22, 3))
    (lying, worn), (swinging, _) = (dressed(model, dancer, swing) for swing in (0.002, 0.06))
    cases = ((lying, NAKED), (lying, worn), (swinging, worn))
    without, lies, swings = (errors_mm(model, truth, register(model, astray, *case).found)[0] for case in cases)
    assert lies < 0.6 * without and swings < 0.8 * without, (without, lies, swings)


def dressed(model, dancer, swing):
    """Skin and a dress beside it, and the dress' faces; `swing` [m]: how far its lower half is off the skin after the first frame."""
    truth, _, bare = dancer
    rng, x = np.random.default_rng(2), truth.posed.vertices
    hidden = model.skin & ~np.isin(np.arange(len(model.skin)), bare.index)
    n, dress = np.array([vertex_normals(v, model.faces) for v in x]), np.flatnonzero(hidden)
    low = x[0, dress, 1] < np.median(x[0, dress, 1])
    worn = []
    for f in range(FRAMES):
        slide = 0.005 * rng.standard_normal(3) * (f > 0)
        along = slide - (n[f, dress] @ slide)[:, None] * n[f, dress]
        worn.append(x[f, dress] + np.where(low & (f > 0), swing, 0.002)[:, None] * n[f, dress] + along)
    surface = np.concatenate([np.where(bare.seen[..., None], bare.vertices, x), worn], 1)
    seen = np.concatenate([bare.seen, np.ones((FRAMES, len(dress)), bool)], 1)
    surface[0, : len(hidden)], seen[0, : len(hidden)] = x[0], model.skin
    number = np.cumsum(hidden) - 1 + len(hidden)
    faces = number[model.faces[hidden[model.faces].all(1)]].astype(np.int32)
    return Skin(surface, np.concatenate([model.faces, faces]), np.flatnonzero(model.skin), seen), faces


def test_what_clings_is_what_is_close_and_borders_that_are_fastened():
    """A sheet lies 2 cm over another, but for one corner that touches it: its border clings if it is there all around."""
    x, faces = sheet(20, 20, length=0.4, width=0.4)
    n = vertex_normals(x, faces)
    over = x + 0.02 * n
    over[-1] = x[-1] + 2e-3 * n[-1]
    border = np.unique(boundary_edges(faces))
    found = clinging(over, faces, x, faces)
    np.testing.assert_array_equal(found.vertex, border)
    np.testing.assert_allclose(found.height, np.where(border == len(x) - 1, 2e-3, 0.02), atol=1e-6)
    over[border[0]] += 2 * LOOP * n[border[0]]
    np.testing.assert_array_equal(clinging(over, faces, x, faces).vertex, [len(x) - 1])
    hidden = np.ones(len(x), bool)
    hidden[border[1]] = False
    assert border[1] not in found.at(over, hidden).vertex and len(found.at(over, hidden).vertex) == len(border) - 1


def test_the_slope_is_that_of_the_energy_and_the_curvature_never_negative():
    rng = np.random.default_rng(0)
    normal = rng.standard_normal((7, 3))
    term = SkinDistance(rng.standard_normal((7, 3)) * 0.02, normal / np.linalg.norm(normal, axis=1, keepdims=True))
    p, direction, e = rng.standard_normal((7, 3)) * 0.02, rng.standard_normal((7, 3)), 1e-6
    both = Together(
        (
            replace(term, target=term.target[:4], normal=term.normal[:4]),
            replace(term, target=term.target[4:], normal=term.normal[4:], saturation=0.01),
        )
    )
    for E in (term, both):
        _, gradient, curvature = E.expand(p)
        slope = (E.energy(p + e * direction) - E.energy(p - e * direction)) / (2 * e)
        assert np.sum(gradient * direction) == pytest.approx(slope, rel=1e-6)
        assert np.linalg.eigvalsh(curvature).min() > 0


def test_only_what_is_near_and_faces_the_same_way_is_matched():
    x, faces = sheet(6, 6, length=0.4, width=0.4)
    n = vertex_normals(x, faces)
    for skin, normal, kept in ((x + 1e-3 * n, n, len(x)), (x + 1e-3 * n, -n, 0), (x + 2 * FARTHEST * n, n, 0)):
        assert len(matched(skin, normal, x, faces).skin) == kept
