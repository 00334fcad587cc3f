"""An atlas that is the pattern at some scale is recognised and brought to metres; one that is not is refused."""

import numpy as np

from tasks.cloth.rest_shape import pattern
from tests.geometry.test_meshes import grid


def rolled():
    """A flat sheet rolled into a half cylinder: isometric to its pattern."""
    flat, faces = grid(8, 12)
    flat = flat[:, :2] * 0.03
    angle = flat[:, 0] / 0.1
    return np.stack([0.1 * np.sin(angle), flat[:, 1], 0.1 * np.cos(angle)], 1), faces, flat


def test_a_scaled_pattern_is_brought_to_metres():
    x, faces, flat = rolled()
    uv = pattern(x, faces, flat * 0.37 + 0.1, faces)
    np.testing.assert_allclose(
        np.linalg.norm(uv[:, 1] - uv[:, 0], axis=-1), np.linalg.norm(x[faces[:, 1]] - x[faces[:, 0]], axis=-1), rtol=0.02
    )


def test_a_stretched_atlas_is_no_pattern():
    x, faces, flat = rolled()
    assert pattern(x, faces, flat * [1.0, 1.5], faces) is None
    assert pattern(x, faces, np.zeros((0, 2)), faces) is None
