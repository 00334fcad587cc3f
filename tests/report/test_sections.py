"""The heat map of the gap, read back from the page: what was never seen is grey, not without error."""

import base64

import cv2
import numpy as np
import pytest

from tasks.geometry.cameras import Cameras
from tasks.report.sections import gap_section

TABLES = {"zones": [], "directions_mm": {}, "bands": [], "frame_mm": [1.0, 1.0]}


def shown(residual_mm):
    """(colour [n, 3] of the middle of each of n squares side by side, caption); residual_mm [2, n] at all corners of a square."""
    squares = residual_mm.shape[1]
    corner = np.array([[0, 0], [0, 1], [1, 1], [1, 0.0]])
    x = np.concatenate([np.column_stack([corner + np.array([k, 0]), np.zeros(4)]) for k in range(squares)])
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(squares)]).astype(np.int32)
    K, t = np.array([[[40.0, 0, 0], [0, 40, 0], [0, 0, 1]]]), np.array([[0.0, 0, 1]])
    camera = Cameras(("front",), K, np.eye(3)[None], t, np.array([[40 * squares, 40]]), np.zeros((1, 5)))
    image = np.zeros((40, 40 * squares, 3), np.uint8)
    heat, _ = gap_section(image, camera, 0, x, faces, np.repeat(residual_mm, 4, axis=1), TABLES, 25.0).figures
    jpeg = np.frombuffer(base64.b64decode(heat.uri.split(",")[1]), np.uint8)
    return cv2.imdecode(jpeg, cv2.IMREAD_COLOR_RGB)[20, 20::40].astype(int), heat.caption


def test_what_was_never_seen_is_grey():
    """By hand: rms of (3, 4) is 3.5 mm; what was seen once has the error it had then."""
    colour, caption = shown(np.array([[np.nan, 0, 3, 2], [np.nan, 0, 4, np.nan]]))
    assert colour[0] == pytest.approx(128, abs=6)
    assert colour[1].max() < 20  # no error is black
    assert colour[2].max() > 150 and np.ptp(colour[3]) > 60  # inferno, not grey
    assert "yellow 3.5 mm" in caption


def test_what_was_never_seen_does_not_lower_the_scale():
    """Of thirty squares one was seen: its error is the 95th percentile of what is known."""
    assert "yellow 5.0 mm" in shown(np.where(np.arange(30) == 7, 5.0, np.nan) * np.ones((2, 1)))[1]


def test_a_gap_of_which_nothing_was_seen_is_drawn_all_the_same():
    colour, caption = shown(np.full((2, 4), np.nan))
    assert colour == pytest.approx(128, abs=6)
    assert "yellow 0.0 mm" in caption
