import numpy as np
import pytest

from tasks.body.wholebody import FLIP, FROM_OPENPOSE, KEYPOINT, LEFT_HAND, LIMBS, NAMES, RIGHT_HAND, keypoints133, placement


@pytest.fixture(scope="module")
def keypoints(model):
    posed = model.pose(np.zeros(10), np.zeros(10), np.zeros((55, 3)), np.zeros(3))
    return keypoints133(model, posed.vertices, posed.joints)


def test_order_is_that_of_coco_wholebody():
    assert len(NAMES) == len(set(NAMES)) == 133
    assert [KEYPOINT[name] for name in ("nose", "right_ankle", "left_big_toe", "right_heel", "face_0")] == [0, 16, 17, 22, 23]
    assert [KEYPOINT[name] for name in ("left_hand_wrist", "left_hand_thumb4", "left_hand_index1", "right_hand_wrist")] == [91, 95, 96, 112]
    assert NAMES[132] == "right_hand_pinky4"


def test_flip_is_the_mirror_image(keypoints):
    assert (FLIP[FLIP] == np.arange(133)).all()
    assert np.linalg.norm(keypoints[FLIP] * [-1, 1, 1] - keypoints, axis=1).max() < 0.003


def test_another_order_is_not_the_mirror_image(keypoints):
    swapped = FLIP.copy()
    swapped[[36 + 23, 39 + 23]] = swapped[[39 + 23, 36 + 23]]
    assert np.linalg.norm(keypoints[swapped] * [-1, 1, 1] - keypoints, axis=1).max() > 0.02


def test_every_keypoint_but_the_contour_belongs_to_a_limb_or_the_face():
    assert set(LIMBS.ravel()) == {*range(23), *LEFT_HAND, *RIGHT_HAND}
    assert len(LIMBS) == 25 + 40


def test_finger_chains_run_outwards(keypoints):
    for wrist, sign in ((91, 1), (112, -1)):
        for finger in range(5):
            chain = keypoints[[wrist, *range(wrist + 1 + 4 * finger, wrist + 5 + 4 * finger)]]
            assert (np.diff(chain[:, 0]) * sign > 0).all()
        knuckles = keypoints[[wrist + 1 + 4 * finger for finger in range(5)]]
        assert (np.diff(knuckles[1:, 2]) < 0).all()  # palms down, thumbs in front: index, middle, ring, little finger backwards


def test_openpose_134_becomes_coco_133():
    """By names: OpenPose-18 as its documentation lists it, with the neck second."""
    right_arm, left_arm = ([f"{side}_{part}" for part in ("shoulder", "elbow", "wrist")] for side in ("right", "left"))
    right_leg, left_leg = ([f"{side}_{part}" for part in ("hip", "knee", "ankle")] for side in ("right", "left"))
    head = ["right_eye", "left_eye", "right_ear", "left_ear"]
    openpose = ["nose", "neck", *right_arm, *left_arm, *right_leg, *left_leg, *head, *NAMES[17:]]
    assert [openpose[k] for k in FROM_OPENPOSE] == list(NAMES)


def test_face_lies_on_the_face(model, keypoints):
    place = placement(model)
    face = keypoints[23:91]
    assert (place.joint[23:91] == -1).all()
    assert (face[:, 2] > 0).all()
    chin, brow, tip = face[8], face[19], face[30]
    assert chin[1] < tip[1] < brow[1]
    assert tip[2] == face[17:, 2].max()
    assert face[36, 0] < face[39, 0] < face[42, 0] < face[45, 0]  # from the person's right to the left
