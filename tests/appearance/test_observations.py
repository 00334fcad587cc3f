"""Which pixels are used: erosion by hand, reduction in linear light, refusals."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.appearance.colour import linear_from_srgb
from tasks.appearance.observations import camera_faults, erode, observe
from tasks.geometry.faults import BadInput
from tests.appearance.stage_figure import ring


def test_two_pixels_go_from_every_border_but_the_images_own():
    mask = np.zeros((12, 12), bool)
    mask[3:10, 0:8] = True
    kept = np.zeros((12, 12), bool)
    kept[5:8, 0:6] = True
    np.testing.assert_array_equal(erode(mask, 2), kept)


def test_reduction_averages_light_not_codes():
    image = np.zeros((20, 20, 3), np.uint8)
    image[::2] = 255
    mask = np.ones((20, 20))
    mask[:, 0] = 0.99
    linear, usable = observe(lambda f, k: image, lambda f, k: mask, 0, 0, reduce=2)
    np.testing.assert_allclose(linear, 0.5)  # codes would give 128, which is 0.216
    assert not usable[:, :2].any()  # column 0 is not opaque: columns 0 to 2 erode, and with column 2 its block
    assert usable[:, 2:].all()
    full, _ = observe(lambda f, k: image, lambda f, k: mask, 0, 0)
    np.testing.assert_array_equal(full, linear_from_srgb(image))


def test_a_mask_of_another_size_is_refused():
    with pytest.raises(BadInput, match="frame 3, camera 1"):
        observe(lambda f, k: np.zeros((8, 8, 3), np.uint8), lambda f, k: np.ones((8, 9)), 3, 1)


def test_distorted_cameras_and_odd_sizes_are_all_named():
    rig = ring(2, 90)
    assert camera_faults(rig, 1) == []
    bent = replace(rig, distortion=np.array([[0, 0, 0, 0, 0], [0.1, 0, 0, 0, 0]]))
    assert [fault.where for fault in camera_faults(bent, 4)] == ["camera Cam001", "camera Cam002", "camera Cam002"]
