"""Reference colours and camera gains."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.tracking import pyramid, reference
from tasks.tracking.photometric import colours
from tasks.tracking.settings import Settings
from tasks.tracking.surface import surface
from tasks.tracking.visibility import facing_cosines
from tests.tracking.skirt import skirt

SETTINGS = Settings()


@pytest.fixture(scope="module")
def small():
    s = skirt(columns=24, rows=15, frames=3, size=128, views=4)
    mesh = surface(s.vertices[0], s.faces, np.full(len(s.faces), "skirt"), SETTINGS)
    cosine = facing_cosines(s.vertices[0], mesh, s.cameras, occluder=None, side=None, facing=0.2, settings=SETTINGS)
    return s, mesh, cosine, pyramid.level(pyramid.stack(s.image, s.mask, 0, s.cameras), 1.0)


def test_fine_levels_expect_the_weighted_mean_everywhere(small):
    s, mesh, cosine, fine = small
    taken = reference.take(s.vertices[0], mesh, [fine], s.cameras, cosine)
    assert np.ptp(taken.colour[0][taken.known], axis=1).max() < 1e-6
    several = (cosine > 0).sum(1) > 1
    assert several.mean() > 0.3


def test_coarse_levels_lean_half_on_the_own_view(small):
    s, mesh, cosine, fine = small
    coarse = replace(fine, blur=4.0)  # the same pixels, called coarse: the two references then differ only by the rule
    a, b = reference.take(s.vertices[0], mesh, [fine, coarse], s.cameras, cosine).colour
    weight = np.maximum(cosine * reference.better_side(cosine)[:, None], 0)
    own = colours(s.vertices[0], mesh.faces, mesh.barycentric, level=fine, cameras=s.cameras, weight=weight)
    assert b[weight > 0] == pytest.approx((own[weight > 0] + a[weight > 0]) / 2, abs=1e-6)
    assert b[weight == 0] == pytest.approx(a[weight == 0], abs=1e-6)


def test_what_no_camera_saw_is_unknown(small):
    s, mesh, cosine, fine = small
    blind = cosine.copy()
    blind[:50] = 0
    assert not reference.take(s.vertices[0], mesh, [fine], s.cameras, blind).known[:50].any()


def test_planted_camera_gains_are_found_and_undone(small):
    """The mean colour changes with the cameras, so a gain is found to a fifth of its departure from 1 where few cameras overlap."""
    s, mesh, cosine, fine = small
    rng = np.random.default_rng(0)
    gain, offset = rng.uniform(0.8, 1.2, (4, 3)), rng.uniform(-0.03, 0.03, (4, 3))
    gain /= gain.mean(0)
    offset -= gain * (offset / gain).mean(0)
    spoilt = fine.pixels.copy()
    for k, (w, h) in enumerate(fine.size):
        rows = slice(fine.offset[k], fine.offset[k] + w * h)
        spoilt[rows, :3] = spoilt[rows, :3] * gain[k] + offset[k] * spoilt[rows, 3:]
    bad = replace(fine, pixels=spoilt)
    found_gain, found_offset = reference.camera_gains(s.vertices[0], mesh, bad, s.cameras, cosine)
    clean_gain, _ = reference.camera_gains(s.vertices[0], mesh, fine, s.cameras, cosine)
    assert np.abs(found_gain / clean_gain - gain).mean() < 0.2 * np.abs(gain - 1).mean()
    restored = reference.corrected(bad, found_gain, found_offset).pixels
    assert np.abs(restored - fine.pixels).mean() < 0.25 * np.abs(spoilt - fine.pixels).mean()
