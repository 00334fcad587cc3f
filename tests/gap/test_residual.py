"""The split of a residual that was put together by hand."""

import numpy as np
import pytest

from tasks.gap.residual import weft_direction, where
from tasks.gap.zones import ZONES, zones
from tests.geometry.test_meshes import grid

FPS = 25.0


def sheet():
    x, faces = grid(5, 7)
    return x * 0.02, faces


def split(r: np.ndarray, *, noise: float = 1e-3, zone: np.ndarray | None = None):
    x, faces = sheet()
    still = np.tile(x, (len(r), 1, 1))
    uv = x[:, :2]
    zone = np.zeros(len(x), np.int32) if zone is None else zone
    weft = weft_direction(still, faces, uv, faces)
    shape = r.shape[:2]
    return where(still + r, still, seen=np.ones(shape, bool), noise_m=np.full(shape, noise), zone=zone, faces=faces, weft=weft, fps=FPS)


def test_a_swing_along_the_normal_is_found_in_its_direction_and_band():
    t = np.arange(50) / FPS
    r = np.zeros((50, 35, 3))
    r[..., 2] = 0.004 * np.sqrt(2) * np.sin(2 * np.pi * 1.5 * t)[:, None]
    found = split(r)
    assert found.rms_mm == pytest.approx(4.0, rel=1e-6)
    assert found.by_direction["normal"] == pytest.approx(4.0, rel=1e-6)
    assert found.by_direction["warp"] < 1e-9 > found.by_direction["weft"]
    bands = {row["band"]: row["rms_mm"] for row in found.by_band}
    assert bands["1–2.5 Hz"] == pytest.approx(4.0, rel=0.02)
    assert bands["above 6 Hz"] < 0.1


def test_a_band_without_a_frequency_has_no_row():
    """A second holds none below 1 Hz; a row of it said that nothing was there."""
    found = split(np.random.default_rng(0).standard_normal((25, 35, 3)))
    assert [row["band"] for row in found.by_band] == ["constant", "1–2.5 Hz", "2.5–6 Hz", "above 6 Hz"]


def test_a_constant_offset_along_weft_is_its_own_band_and_lies_in_its_zone():
    zone = np.where(np.arange(35) < 7, ZONES.index("contact"), ZONES.index("free"))
    r = np.zeros((20, 35, 3))
    r[:, :7, 0] = 0.003
    found = split(r, zone=zone.astype(np.int32))
    rows = {row["zone"]: row for row in found.by_zone}
    assert rows["contact"]["share"] == pytest.approx(1.0)
    assert rows["contact"]["rms_mm"] == pytest.approx(3.0)
    assert rows["free"]["rms_mm"] == 0.0
    assert found.by_direction["weft"] == pytest.approx(3.0 * np.sqrt(7 / 35))
    assert {row["band"]: row["rms_mm"] for row in found.by_band}["constant"] == pytest.approx(3.0 * np.sqrt(7 / 35))


def test_pure_noise_sits_at_its_floor_and_a_gap_above():
    noise = np.random.default_rng(0).normal(scale=1e-3, size=(60, 35, 3))
    found = split(noise)
    assert found.rms_mm == pytest.approx(found.floor_mm, rel=0.03)
    assert split(noise + 0.01).rms_mm > 5 * found.floor_mm  # negative control


def test_what_was_not_seen_is_not_compared():
    x, faces = sheet()
    still = np.tile(x, (10, 1, 1))
    seen = np.ones((10, 35), bool)
    seen[:, 3] = False
    moved = still.copy()
    moved[:, 3] += 1.0
    found = where(moved, still, seen=seen, noise_m=np.ones((10, 35)), zone=np.zeros(35, np.int32), faces=faces, weft=None, fps=FPS)
    assert found.rms_mm == 0.0
    assert np.isnan(found.vertex_mm[3])


def test_zones_by_rank():
    _, faces = sheet()
    far, near = np.full((4, 35), 0.1), np.full((4, 35), 0.1)
    pinned = np.arange(35) == 0
    near[:, [0, 17]] = 0.001
    plain = zones(faces, None, far, pinned)
    assert ZONES[plain[0]] == "pinned"
    assert ZONES[plain[1]] == "hem"
    assert ZONES[plain[17]] == "free"
    assert ZONES[zones(faces, None, near, pinned)[17]] == "contact"
    cut = faces.copy()
    cut[:10] += 100  # these faces have a pattern piece of their own
    seam = set(faces[:10].ravel()) & set(faces[10:].ravel()) - {0}
    assert {i for i, k in enumerate(zones(faces, cut, far, pinned)) if ZONES[k] == "seam"} == seam


def test_contact_is_nearness_in_more_than_half_of_the_frames():
    _, faces = sheet()
    for millimetres, frames, expected in ((7.0, 3, "contact"), (7.0, 2, "free"), (9.0, 4, "free")):
        away = np.full((4, 35), 0.1)
        away[:frames, 17] = millimetres / 1e3
        assert ZONES[zones(faces, None, away, np.zeros(35, bool))[17]] == expected
