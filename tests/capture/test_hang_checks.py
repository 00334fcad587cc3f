"""Cloth that hangs sideways hangs in a file whose axes are not what they are said to be; on a body it may have its reasons."""

import numpy as np
import pytest

from tasks.capture.hang_checks import hang_faults, hang_warnings
from tests.capture.test_tracked_geometry import square


def panel(*, up="y", turned=False, frames=12):
    """A square that hangs from vertices 6–8 and sways; `turned`: its vertical axis is z."""
    x, faces = square()
    t = np.arange(frames)
    vertices = x + np.stack([0 * t, 0 * t, 0.02 * np.sin(t)], 1)[:, None] * (1 - x[:, 1:2])
    if turned:
        vertices = vertices[..., [0, 2, 1]]
    return {"vertices": vertices, "faces": faces, "fps": 25, "boundary": np.array([6, 7, 8]), "up": up}


def test_a_panel_that_hangs_is_sound_along_either_axis():
    for arrays in (panel(), panel(up="z", turned=True)):
        assert hang_faults(arrays, "t.npz") == [] and hang_warnings(arrays, "t.npz") == []


@pytest.mark.parametrize("arrays", [panel(up="z"), panel(turned=True), panel() | {"vertices": -panel()["vertices"]}])
def test_a_panel_that_hangs_sideways_or_upwards_is_refused(arrays):
    (fault,) = hang_faults(arrays, "t.npz")
    assert "t.npz: up" in str(fault) and "away from downwards" in str(fault) and "Set up" in str(fault)


def test_where_a_body_may_hold_it_this_is_only_told():
    arrays = panel(up="z") | {"collider_vertices": np.zeros((12, 3, 3))}
    assert hang_faults(arrays, "t.npz") == []
    assert "90 degrees away" in hang_warnings(arrays, "t.npz")[0]


def test_what_swings_through_the_vertical_or_is_too_short_is_not_judged():
    swinging = panel(up="z")
    swinging["vertices"][6] = swinging["vertices"][6][:, [0, 2, 1]]
    assert hang_faults(swinging, "t.npz") == []
    assert hang_faults(panel(up="z", frames=5), "t.npz") == []
    free = panel(up="z")
    del free["boundary"]
    assert hang_faults(free, "t.npz") == []


def test_a_blind_file_is_not_judged():
    arrays = panel(up="z")
    arrays["vertices"][2:, :6] = np.nan
    assert hang_faults(arrays, "t.npz") == [] and hang_warnings(arrays, "t.npz") == []
