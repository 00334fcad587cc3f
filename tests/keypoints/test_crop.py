"""From a picture to a crop and back: coordinates to rounding, content to a fraction of a pixel."""

import numpy as np
import pytest

from tasks.keypoints.crop import PADDING, crop_matrix, map_back, map_forth, warp

SIZE = (192, 256)


def test_box_lands_in_the_middle_padded_by_a_quarter():
    box = np.array([100.0, 50.0, 400.0, 850.0])
    matrix = crop_matrix(box, SIZE)
    np.testing.assert_allclose(map_forth(np.array([250.0, 450.0]), matrix), [96, 128])
    corners = map_forth(box.reshape(2, 2), matrix)
    assert np.ptp(corners[:, 1]) == pytest.approx(256 / PADDING)
    assert np.ptp(corners[:, 0]) / np.ptp(corners[:, 1]) == pytest.approx(300 / 800)  # one scale for both axes


def test_round_trip():
    matrix = crop_matrix(np.array([-30.0, 10.0, 333.3, 800.1]), SIZE)
    uv = np.random.default_rng(0).uniform(-50, 900, (40, 2))
    np.testing.assert_allclose(map_back(map_forth(uv, matrix), matrix), uv, atol=1e-9)


@pytest.mark.parametrize("box", [[100, 80, 500, 700], [260.3, 110.7, 420.2, 333.9], [-80, -60, 300, 500]])
def test_content_moves_as_the_coordinates_say(box):
    """Blobs drawn at known places, crop, centroid: where the matrix maps them. A half-pixel slip would show as 0.5·(1 − s)."""
    matrix = crop_matrix(np.array(box, float), SIZE)
    s = matrix[0, 0]
    v, u = np.mgrid[:900, :700] + 0.5
    for at in map_back(np.array([[70.25, 60.0], [120.0, 200.5]]), matrix):
        if (at < 20).any():
            continue
        blob = 250 * np.exp(-((u - at[0]) ** 2 + (v - at[1]) ** 2) / (2 * (4 / s) ** 2))
        image = np.repeat(blob[..., None], 3, axis=2).astype(np.uint8)
        crop = warp(image, matrix, SIZE)[..., 0].astype(float)
        y, x = np.mgrid[: SIZE[1], : SIZE[0]] + 0.5
        centroid = np.array([(crop * x).sum(), (crop * y).sum()]) / crop.sum()
        np.testing.assert_allclose(centroid, map_forth(at, matrix), atol=0.12)


def test_shrinking_does_not_alias():
    """A checkerboard of single pixels shrunk eight times is grey; plain bilinear sampling leaves a pattern."""
    board = np.repeat((np.indices((2048, 1536)).sum(0) % 2 * 255).astype(np.uint8)[..., None], 3, axis=2)
    crop = warp(board, crop_matrix(np.array([150.0, 200.0, 1386.0, 1848.0]), SIZE), SIZE).astype(float)
    assert crop[20:-20, 20:-20].std() < 3


def test_outside_the_picture_is_black():
    crop = warp(np.full((100, 100, 3), 200, np.uint8), crop_matrix(np.array([300.0, 300.0, 400.0, 400.0]), SIZE), SIZE)
    assert crop.max() == 0
