"""Constancy of a strength: Cochran's Q against its distribution, and strengths that hold or drift."""

import numpy as np
import pytest

from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.shooting import Evidence
from tasks.cloth.windows import Prediction, Window
from tasks.gap.constancy import by_speed, by_window, by_zone, cochran, speeds
from tests.gap.synthetic import EFFECTS, NAMES, windows

DRAG, _, FRICTION, _, TILT = EFFECTS


def test_Q_of_a_constant_follows_chi_squared():
    rng = np.random.default_rng(0)
    σ = rng.uniform(0.5, 2.0, 8)
    p = np.array([cochran(3.0 + σ * rng.standard_normal(8), σ)[2] for _ in range(2000)])
    assert np.mean(p < 0.1) == pytest.approx(0.1, abs=0.025) and np.mean(p < 0.5) == pytest.approx(0.5, abs=0.04)


def test_one_place_has_no_Q():
    Q, freedom, p = cochran(np.ones(1), np.ones(1))
    assert np.isnan(Q) and freedom == 0 and np.isnan(p)


def test_a_constant_strength_is_one_everywhere_within_its_spread():
    w = windows(np.random.default_rng(1), lambda k: {"air_normal_drag": 8.0, "contact_friction": 0.3}, count=12)
    named = w.fit([DRAG, FRICTION])
    for found in (by_window(w, named), by_speed(w, named, np.arange(12.0))):
        for c in found.values():
            assert c.p > 0.01 and np.abs((c.multiples - 1) / c.deviations).max() < 4
    assert by_window(w, named)["air_normal_drag"].places == tuple(str(k) for k in range(1, 13))


def test_a_strength_that_drifts_with_speed_is_told():
    speed = np.linspace(0.2, 1.0, 12)[np.random.default_rng(2).permutation(12)]
    w = windows(np.random.default_rng(3), lambda k: {"air_normal_drag": 8.0 / speed[k]}, count=12)
    found = by_speed(w, w.fit([DRAG]), speed)["air_normal_drag"]
    assert found.places == ("slow", "middle", "fast")
    assert found.multiples[0] > 1.5 * found.multiples[2] and found.p < 1e-3 and found.scatter > 2
    assert by_window(w, w.fit([DRAG]))["air_normal_drag"].p < 1e-6


def test_an_effect_of_two_components_has_one_multiple():
    w = windows(np.random.default_rng(4), lambda k: {"gravity_tilt.θ_x": 0.05, "gravity_tilt.θ_z": -0.03}, count=8)
    found = by_window(w, w.fit([TILT]))
    assert list(found) == ["gravity_tilt"] and found["gravity_tilt"].multiples.mean() == pytest.approx(1, abs=0.1)


def test_a_strength_of_one_zone_only_is_told():
    rng, zone = np.random.default_rng(5), np.array(["hem"] * 20 + ["free"] * 20 + ["pinned"] * 3)
    w = windows(rng, lambda k: {"air_normal_drag": 6.0}, count=6)
    named, evidence = w.fit([DRAG]), []
    for k in range(6):
        columns = {c: 1e-3 * rng.standard_normal((5, 43, 3)) for c in (*PARAMETERS, *NAMES[2:], "numerics_mesh", "numerics_time_step")}
        columns["numerics_time_step"] = 3.0 * columns["air_normal_drag"]  # left in, it would be taken for half as much again
        finer = columns["numerics_mesh"] + columns["numerics_time_step"]
        r = 6.0 * columns["air_normal_drag"] * (zone == "hem")[:, None] + finer + 1e-4 * rng.standard_normal((5, 43, 3))
        r[0, 3] = np.nan
        evidence.append(Evidence(Prediction(Window(0, 5 * k, 5), np.zeros((6, 43, 3)), columns, "converged", 1), None, r))
    found = by_zone(evidence, named, zone)["air_normal_drag"]
    multiple = dict(zip(found.places, found.multiples * named.strengths["air_normal_drag"], strict=True))
    assert set(multiple) == {"hem", "free"}
    assert multiple["hem"] == pytest.approx(6.0, rel=0.02) and multiple["free"] == pytest.approx(0.0, abs=0.1)


def test_speed_is_that_of_the_cloth():
    x = np.cumsum(np.full((6, 4, 3), [0.03, 0.04, 0.0]), 0)
    assert speeds([Evidence(Prediction(Window(0, 0, 5), x, {}, "converged", 1), None, None)], 30.0) == pytest.approx(1.5)
