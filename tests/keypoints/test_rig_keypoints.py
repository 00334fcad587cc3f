"""Views that look at the wrong figure are set right by the others: a detector that finds whoever stands in its box, and two figures."""

from dataclasses import dataclass

import numpy as np
import pytest

from tasks.geometry.cameras import Cameras, project
from tasks.keypoints.detector import Detections
from tasks.keypoints.person_box import NOWHERE, box_from_mask, moving_person, temporal_median
from tasks.keypoints.rig_keypoints import agreed_points, follow_masks, follow_motion
from tasks.keypoints.sides import same_sides
from tests.keypoints.test_person_box import box_of, rig  # noqa: F401

FRAMES = 5


def figure(at: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """133 points of a person-sized cloud at `at`."""
    return at + random.uniform([-0.25, 0, -0.25], [0.25, 1.75, 0.25], (133, 3))


@dataclass
class InBox:
    """Finds the figure nearest to the middle of the box; a picture is only its (frame, camera)."""

    figures: np.ndarray  # [figure, frame, camera, 133, 2] px

    def detect(self, images, *, masks=None, boxes=None, refine=0):
        boxes = np.array([box_from_mask(mask) for mask in masks]) if boxes is None else boxes.copy()
        uv = np.full((len(images), 133, 2), np.nan)
        for k, (image, box) in enumerate(zip(images, boxes)):
            frame, camera, _ = image.ravel()
            if np.isfinite(box).all():
                middle = self.figures[:, frame, camera].mean(1)
                nearest = np.linalg.norm(middle - (box[:2] + box[2:]) / 2, axis=1).argmin()
                uv[k] = self.figures[nearest, frame, camera]
        return Detections(uv, np.where(np.isfinite(uv).all(-1), 0.9, 0.0), boxes)


@pytest.fixture
def scene(rig: Cameras):  # noqa: F811
    random = np.random.default_rng(0)
    walk = figure(np.zeros(3), random) + np.arange(FRAMES)[:, None, None] * [0.06, 0, 0.03]
    stands = np.tile(figure(np.array([-1.2, 0, 0.9]), random), (FRAMES, 1, 1))
    uv = np.stack([np.moveaxis(project(rig, x)[0], 1, 0) for x in (walk, stands)]) + random.normal(0, 1, (2, FRAMES, 4, 133, 2))
    images = [[np.array([[[frame, camera, 0]]]) for camera in range(4)] for frame in range(FRAMES)]
    boxes = np.concatenate([uv[:, 0].min(2), uv[:, 0].max(2)], axis=-1)  # [figure, camera, 4]
    return InBox(uv), images, boxes


def test_one_wrong_view_is_mended(rig, scene):  # noqa: F811
    detector, images, boxes = scene
    start = boxes[0].copy()
    start[2] = boxes[1, 2]
    found = follow_motion(detector, rig, images, lambda _: start)
    np.testing.assert_allclose(found.uv, detector.figures[0])


def test_a_view_without_a_box_joins_in(rig, scene):  # noqa: F811
    detector, images, boxes = scene
    start = boxes[0].copy()
    start[1] = np.nan
    np.testing.assert_allclose(follow_motion(detector, rig, images, lambda _: start).uv, detector.figures[0])


def test_when_all_views_start_on_the_other_figure_they_stay_there(rig, scene):  # noqa: F811
    """Agreement is all that is checked: the first boxes decide who is followed."""
    detector, images, boxes = scene
    np.testing.assert_allclose(follow_motion(detector, rig, images, lambda _: boxes[1]).uv, detector.figures[1])


def test_who_enters_later_is_followed_from_there(rig, scene):  # noqa: F811
    detector, images, boxes = scene
    sought = [np.tile(NOWHERE, (4, 1)), np.tile(NOWHERE, (4, 1)), boxes[0]]
    found = follow_motion(detector, rig, images, lambda _: sought.pop(0))
    assert not sought
    assert np.isnan(found.uv[:2]).all()
    assert np.isnan(found.box[:2]).all()
    np.testing.assert_allclose(found.uv[2:], detector.figures[0, 2:])
    mended, turned = same_sides(rig, found)
    np.testing.assert_array_equal(mended.uv, found.uv)
    assert not turned.any()


def test_one_who_enters_an_empty_room_is_seen_to_move(rig):  # noqa: F811
    """Nobody is in the first of the pictures, which once decided for all."""
    clip = [[np.zeros((480, 640, 3), np.uint8) for _ in range(4)] for _ in range(7)]
    for t in (4, 5, 6):
        for camera, (left, top, right, bottom) in enumerate(box_of(rig, np.array([0.5 * t - 2.5, 0, 0])).round().astype(int)):
            clip[t][camera][max(top, 0) : bottom, max(left, 0) : right] = 200
    still = [temporal_median([images[camera] for images in clip]) for camera in range(4)]
    assert np.isnan(moving_person(rig, still, clip[0])).all()
    np.testing.assert_allclose(moving_person(rig, still, clip[4]), box_of(rig, np.array([-0.5, 0, 0])), atol=5)


def test_agreed_points_shrug_off_one_gross_error(rig):  # noqa: F811
    x = figure(np.zeros(3), np.random.default_rng(1))
    uv, _ = project(rig, x)
    uv[0, :40] += 120
    found, residual = agreed_points(rig, uv, np.ones(uv.shape[:2]), scale=5.0)
    np.testing.assert_allclose(found, x, atol=2e-3)
    assert np.median(residual[0, :40]) > 100
    assert np.median(residual[1:]) < 1


def test_masks_need_no_agreement(scene):
    detector, images, boxes = scene
    masks = []
    for left, top, right, bottom in boxes[0].round().astype(int):
        masks.append(np.zeros((480, 640), bool))
        masks[-1][top:bottom, left:right] = True
    found = follow_masks(detector, [(pictures, masks) for pictures in images])
    np.testing.assert_allclose(found.uv[0], detector.figures[0, 0])
    np.testing.assert_array_equal(found.box[0], boxes[0].round())
