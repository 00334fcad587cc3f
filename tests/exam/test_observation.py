"""Noise, gaps and smoothing as stated."""

import numpy as np
import pytest

from tasks.exam.generator.observation import dropouts, noise, smoothed
from tasks.exam.generator.pattern_mesh import Pattern, flat_mesh, locate


def test_noise_has_its_deviation_and_correlation():
    rng = np.random.default_rng(0)
    rest = np.stack([np.linspace(0, 0.6, 40), np.zeros(40), np.zeros(40)], 1)
    ε = noise(rest, 900, 30.0, 2e-3, rng)
    assert ε.std() == pytest.approx(2e-3, rel=0.05)
    assert np.mean(ε[1:] * ε[:-1]) / ε.var() == pytest.approx(0.5 * np.exp(-1 / (30 * 0.12)), abs=0.04)
    apart = np.mean(ε[:, 4:] * ε[:, :-4]) / ε.var()  # 61.5 mm
    assert apart == pytest.approx(0.5 * np.exp(-0.5 * (0.0615 / 0.06) ** 2), abs=0.05)
    white = noise(rest, 900, 30.0, 2e-3, rng, white=1.0)
    assert abs(np.mean(white[1:] * white[:-1])) < 0.03 * white.var()


def test_dropouts_leave_the_first_frames_and_about_their_share():
    rest = np.random.default_rng(1).uniform(0, 0.4, (300, 3))
    seen = dropouts(40, rest, 0.05, np.random.default_rng(2))
    assert seen[:2].all() and 0.04 < (~seen).mean() < 0.12
    assert dropouts(40, rest, 0.0, np.random.default_rng(2)).all()


def test_smoothing_damps_a_sine_as_a_gaussian_does_and_keeps_straight_motion():
    t = np.arange(60) / 30
    x = np.sin(2 * np.pi * 2 * t)[:, None, None] * np.ones((1, 1, 3))
    gain = np.ptp(smoothed(x, 30.0, 0.05)[15:45]) / np.ptp(x[15:45])
    assert gain == pytest.approx(np.exp(-0.5 * (2 * np.pi * 2 * 0.05) ** 2), rel=0.02)
    line = t[:, None, None] * np.ones((1, 2, 3))
    assert smoothed(line, 30.0, 0.05) == pytest.approx(line)


@pytest.mark.parametrize("pattern", [Pattern(0.4, 0.5), Pattern(0.8, 0.35, inner=0.3, sewn=True)])
def test_pattern_meshes_cover_the_pattern_once(pattern):
    mesh = flat_mesh(pattern, 300, np.random.default_rng(3))
    p = pattern.place(mesh.s, mesh.t)[mesh.faces]
    e, f = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    areas = (e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]) / 2
    assert areas.min() > 0 and areas.sum() == pytest.approx(pattern.area, rel=0.01)
    assert 240 < mesh.vertex.max() + 1 < 380


def test_points_are_found_in_their_triangles():
    pattern = Pattern(0.4, 0.5)
    mesh = flat_mesh(pattern, 200, np.random.default_rng(4))
    s, t = np.random.default_rng(5).uniform(0, 1, (2, 50))
    face, w = locate(pattern, mesh, s, t)
    found = np.einsum("pkd,pk->pd", pattern.place(mesh.s, mesh.t)[mesh.faces[face]], w)
    assert found == pytest.approx(pattern.place(s, t), abs=1e-12)
