"""Training pictures: labels that lie where the surface is, visibility that follows from depth, and the same picture for the same seed."""

import numpy as np
import pytest

from tasks.body.wholebody import KEYPOINT
from tasks.keypoints.renders import SIZE, Studio
from tasks.keypoints.shading import Light, Room, look_at, render
from tasks.keypoints.surroundings import random_room
from tasks.keypoints.wardrobe import regions

LIMBS = [KEYPOINT[f"{side}_{part}"] for side in ("left", "right") for part in ("wrist", "elbow", "knee", "ankle")]


@pytest.fixture
def plain_scene():
    random = np.random.default_rng(0)
    dark = np.zeros(3)
    return Light(np.array([0, 1.0, 0]), dark, np.ones(3), np.ones(3), dark, False), random_room(np.array([0, 1.5, 3.0]), random)


def test_same_seed_same_picture(body):
    def first() -> np.ndarray:
        studio, random = Studio(body, shapes=10, expressions=10), np.random.default_rng(3)
        return studio.picture(studio.person(random), random).image

    np.testing.assert_array_equal(first(), first())


def test_labels_lie_on_the_person(studio, plain_scene):
    """Drawn alone, the silhouette covers the limbs' keypoints, which lie inside the flesh."""
    random = np.random.default_rng(1)
    for _ in range(4):
        person = studio.person(random)
        R, t = look_at(np.array([1.5, 1.2, 2.8]), np.array([0, 0.9, 0]), 0.1)
        K = np.array([[260.0, 0, 128], [0, 260, 160], [0, 0, 1]])
        _, depth, piece = render(person.pieces, K, R, t, SIZE, *plain_scene)
        p = person.keypoints @ R.T + t
        uv = p[:, :2] / p[:, 2:] * 260 + [128, 160]
        i, j = np.floor(uv[LIMBS]).astype(int).T
        assert (piece[j, i] >= 0).all()
        assert (depth[j, i] < p[LIMBS, 2]).all()  # skin in front of the joint's centre


def test_framing_leaves_a_margin_and_holds_every_keypoint(studio):
    random = np.random.default_rng(2)
    for _ in range(4):
        uv = studio.picture(studio.person(random), random).keypoints
        corner = (np.array(SIZE) - (192, 256)) / 2
        inside = uv - corner
        assert inside.min() > 0 and (inside < (192, 256)).all()
        assert np.max(np.ptp(inside, axis=0) / (192, 256)) > 0.5


def test_the_far_side_of_a_face_is_hidden(studio):
    """From the left the left ear is seen, the right one is not."""
    random = np.random.default_rng(4)
    seen = {"left": [], "right": []}
    for _ in range(25):
        picture = studio.picture(studio.person(random), random)
        for side in seen:
            seen[side].append(picture.visible[KEYPOINT[f"{side}_ear"]])
    both = np.mean(np.array(seen["left"]) & np.array(seen["right"]))
    assert both < 0.6 and np.mean(seen["left"]) > 0.2 and np.mean(seen["right"]) > 0.2


def test_regions_follow_the_limbs(body):
    rest = body.pose(np.zeros(10), np.zeros(10), np.zeros((55, 3)), np.zeros(3))
    where = regions(rest.vertices, rest.joints, body.weights)
    wrist = np.linalg.norm(rest.vertices - rest.joints[20], axis=1) < 0.03
    knee = np.linalg.norm(rest.vertices - rest.joints[4], axis=1) < 0.06
    assert where.arm[wrist].min() > 1.7 and where.leg[wrist].max() == -1
    assert where.leg[knee].min() > 0.7 and where.leg[knee].max() < 1.3
    assert (where.head[rest.vertices[:, 1] > rest.joints[15, 1]] > 0.5).all()


def test_a_white_room_under_a_white_sky_is_evenly_lit():
    """Closed form: with sky = ground = 1 and no sun the light on any surface is 1, so the picture is the colour of the material."""
    from tasks.keypoints.materials import Material
    from tasks.keypoints.surroundings import _box

    dark, colour = np.zeros(3), (0.2, 0.5, 0.7)
    paint = Material(colour, colour)
    light = Light(np.array([0, 1.0, 0]), dark, np.ones(3), np.ones(3), dark, False)
    box = _box(np.ones(3), np.eye(3), np.zeros(3), Material((0.9, 0.1, 0.1), (0, 0, 0)))
    R, t = look_at(np.array([0.3, 1.0, 4.0]), np.zeros(3), 0.0)
    K = np.array([[80.0, 0, 40], [0, 80, 40], [0, 0, 1]])
    image, depth, _ = render([box], K, R, t, (80, 80), light, Room(np.full(3, -5.0), np.full(3, 5.0), (paint,) * 6))
    np.testing.assert_allclose(image[np.isinf(depth)], np.broadcast_to(colour, (np.isinf(depth).sum(), 3)), atol=1e-6)
    np.testing.assert_allclose(image[np.isfinite(depth)][:, 0], 0.9, atol=1e-6)
