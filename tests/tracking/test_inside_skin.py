"""How deep cloth lies inside skin, and what is then said of its noise."""

import numpy as np
import pytest

from tasks.geometry.distances import closest_points
from tasks.tracking import noise
from tasks.tracking.inside_skin import depth_in_skin
from tasks.tracking.settings import Settings
from tasks.tracking.surface import surface
from tests.tracking.skirt import cone, ring

SETTINGS = Settings()
CAMERAS = ring(6, 256)


def worn(share, *, under="body", blind=False):
    """Depth [V] of a skirt of `share` times the width of what is under it, seen by the cameras that it faces or none, and of that."""
    under_x, faces = cone(40, 31)
    x = np.concatenate([under_x * [share, 1, share], under_x])
    mesh = surface(x, np.concatenate([faces, faces + len(under_x)]), np.repeat(["skirt", under], len(faces)), SETTINGS)
    towards = CAMERAS.centres() - x[:, None]
    cosine = (towards * x[:, None] * [1, 0, 1]).sum(-1) / np.linalg.norm(towards, axis=-1) / np.hypot(x[:, 0], x[:, 2])[:, None]
    return np.split(depth_in_skin(x, mesh, CAMERAS.scaled(SETTINGS.buffer_scale), views=(cosine > 0.3) & (not blind)), 2)


@pytest.mark.parametrize("share", [0.99, 0.97, 0.94])
def test_cloth_inside_skin_lies_as_deep_as_the_surfaces_are_apart(share):
    """Against the closest point, which no camera has a part in. Next to a fold's edge a pixel may show the face beside."""
    cloth, skin = worn(share)
    x, faces = cone(40, 31)
    inner = slice(80, -80)  # above and below, cameras look past the skin's edge
    apart = closest_points(x * [share, 1, share], x, faces).distance[inner]
    off = np.abs(cloth[inner] - apart)
    assert np.median(off) < 1e-4 and np.percentile(off, 95) < 0.2 * apart.max()
    assert not skin.any()


def test_cloth_outside_skin_or_inside_cloth_or_seen_by_none_is_not_inside():
    assert not worn(1.03)[0].any()
    assert not worn(0.97, under="top")[0].any()
    assert not worn(0.97, blind=True)[0].any()


def test_one_camera_that_looks_past_the_skin_is_enough():
    """An arm before the chest: a small patch of skin hides the skirt from one camera only."""
    x, faces = cone(40, 31)
    towards = CAMERAS.centres()[0] * [1, 0, 1]
    towards /= np.linalg.norm(towards)
    side = np.cross(towards, [0, 1, 0])
    patch = 0.6 * towards + [0, 0.5, 0] + 0.1 * np.array([side, -side, [0, 1, 0]])
    both, part = np.concatenate([x, patch]), np.append(np.repeat("skirt", len(faces)), "body")
    mesh = surface(both, np.concatenate([faces, [[len(x), len(x) + 1, len(x) + 2]]]), part, SETTINGS)
    views = np.ones((len(both), len(CAMERAS)), bool)
    assert not depth_in_skin(both, mesh, CAMERAS, views=views).any()
    views[:, 1:] = False
    assert depth_in_skin(both, mesh, CAMERAS, views=views).max() > 0.1


def test_depth_is_counted_along_one_direction_of_three():
    σ = noise.stated(np.array([0.001, 0.0]), np.array([0.0, 0.009]))
    assert σ == pytest.approx([0.001, 0.009 / np.sqrt(3)])
