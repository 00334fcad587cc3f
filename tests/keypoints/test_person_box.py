"""Finding the person: masks, movement, and agreement of views, on scenes whose answer is known."""

import numpy as np
import pytest

from tasks.geometry.cameras import Cameras, project
from tasks.keypoints.person_box import box_from_keypoints, box_from_mask, moving_boxes, same_person, temporal_median


@pytest.fixture
def rig() -> Cameras:
    R, t = [], []
    for angle in np.deg2rad([0, 80, 170, 260]):
        eye = np.array([4 * np.sin(angle), 1.4, 4 * np.cos(angle)])
        forward = (np.array([0, 0.9, 0]) - eye) / np.linalg.norm(np.array([0, 0.9, 0]) - eye)
        right = np.cross(forward, [0, 1.0, 0])
        right /= np.linalg.norm(right)
        R.append(np.stack([right, np.cross(forward, right), forward]))
        t.append(-R[-1] @ eye)
    K = np.tile(np.array([[700.0, 0, 320], [0, 700, 240], [0, 0, 1]]), (4, 1, 1))
    return Cameras(tuple("abcd"), K, np.stack(R), np.stack(t), np.tile([640, 480], (4, 1)).astype(np.int32), np.zeros((4, 5)))


def box_of(rig: Cameras, at: np.ndarray) -> np.ndarray:
    """Boxes [camera,4] of a person-sized cylinder that stands at `at`."""
    θ = np.linspace(0, 2 * np.pi, 30)
    x = np.concatenate([np.column_stack([0.25 * np.cos(θ), np.full(30, y), 0.25 * np.sin(θ)]) for y in (0, 1.75)]) + at
    uv, _ = project(rig, x)
    return np.concatenate([uv.min(1), uv.max(1)], axis=1)


def test_box_of_a_mask_covers_its_pixels():
    mask = np.zeros((40, 60), bool)
    mask[5:9, 11:31] = True
    np.testing.assert_array_equal(box_from_mask(mask), [11, 5, 31, 9])
    assert np.isnan(box_from_mask(np.zeros((4, 4)))).all()


def test_box_of_keypoints_ignores_unsure_ones():
    uv, score = np.random.default_rng(0).uniform(100, 200, (133, 2)), np.ones(133)
    uv[4], score[4] = (5000, 5000), 0.05
    box = box_from_keypoints(uv, score, fallback=np.zeros(4))
    assert box[:2].min() > 60 and box[2:].max() < 240
    np.testing.assert_array_equal(box_from_keypoints(uv, 0 * score, fallback=np.arange(4.0)), np.arange(4.0))


def test_the_figure_that_all_views_see_in_one_place_is_chosen(rig):
    person, candidates = box_of(rig, np.array([0.3, 0, -0.2])), []
    strangers = [box_of(rig, np.array(place)) for place in ([-1.4, 0, 1.0], [1.6, 0, 0.8])]
    for camera in range(4):  # each view also sees something else that moves, first in the list; no two of those agree
        stranger = strangers[camera % 2][camera] + [40 * camera, 0, 40 * camera, 0]
        candidates.append(np.stack([stranger, person[camera]]))
    np.testing.assert_allclose(same_person(rig, candidates), person)


def test_a_view_without_the_person_gets_no_box(rig):
    person = box_of(rig, np.zeros(3))
    candidates = [person[0][None], person[1][None], np.array([[10.0, 400, 60, 470]]), np.zeros((0, 4))]
    chosen = same_person(rig, candidates)
    np.testing.assert_allclose(chosen[:2], person[:2])
    assert np.isnan(chosen[2:]).all()


def test_what_moves_is_boxed_and_what_stands_is_not():
    random = np.random.default_rng(0)
    room = random.integers(0, 255, (270, 200, 3)).astype(np.uint8)
    room[60:220, 150:180] = (200, 150, 120)  # a figure that does not move
    frames = []
    for t in range(9):
        frame = room.astype(int)
        frame[80:230, 10 + 12 * t : 45 + 12 * t] = (120, 60, 200)
        frames.append(np.clip(frame + random.integers(-5, 6, frame.shape), 0, 255).astype(np.uint8))
    boxes = moving_boxes([frames[0], frames[4]], temporal_median(frames))
    for found, left in zip(boxes, (10, 58)):
        np.testing.assert_allclose(found[0], [left, 80, left + 35, 230], atol=6)
    assert len(moving_boxes([room], room)[0]) == 0
