"""Algorithm 1 beside a slow, obvious Adam; its behaviour at the top of a range, at failures, and on a swinging panel."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth import stage
from tasks.cloth.adam_fd import DIFFERENCES, FRAMES, HIGH, LOW, Descent, Score, as_algorithm_1, at_ends, descend, minimise
from tasks.cloth.estimates import estimates
from tasks.cloth.scene import replay
from tasks.cloth.stage import FitParameters, Work
from tasks.simulator import Fabric
from tasks.stage import Job
from tests.cloth.test_gauss_newton import observed, panel

TRUTH = np.array([410.0, 2.0, 5.0])
START = np.array([320.0, 1.0, 1.0])


def bowl(θ: np.ndarray) -> Score:
    d = (θ - TRUTH) / (HIGH - LOW)
    return Score(float(1e-4 * (d @ d + 0.3 * d[0] * d[1])), steps=24)


def slow_adam(f, θ, iterations):
    """One coordinate, one line at a time; the ranges' units; forward differences."""
    m, v, path = [0.0] * 3, [0.0] * 3, [θ.copy()]
    for i in range(iterations):
        rate = 0.02 + 0.03 * (1 + np.cos(np.pi * i / iterations)) / 2
        g = []
        for k in range(3):
            there = θ.copy()
            there[k] += DIFFERENCES[k]
            g.append((f(there).loss - f(θ).loss) / DIFFERENCES[k] * (HIGH - LOW)[k])
        θ = θ.copy()
        for k in range(3):
            m[k] = 0.9 * m[k] + 0.1 * g[k]
            v[k] = 0.999 * v[k] + 0.001 * g[k] * g[k]
        largest = max(v) ** 0.5
        for k in range(3):
            step = rate * (m[k] / (1 - 0.9 ** (i + 1))) / ((v[k] / (1 - 0.999 ** (i + 1))) ** 0.5 + 1e-8 * largest)
            θ[k] = min(max(θ[k] - step * (HIGH - LOW)[k], LOW[k]), HIGH[k])
        path.append(θ)
    return np.array(path)


def test_it_walks_as_the_slow_adam_does():
    found = minimise(bowl, Descent.at(START), iterations=12)
    path = slow_adam(bowl, START, 12)
    np.testing.assert_allclose([[r["density"], r["kappa_s"], r["kappa_b"]] for r in found.history], path[:-1], rtol=1e-9)
    np.testing.assert_allclose(found.θ, path[-1], rtol=1e-9)


def test_a_hundred_iterations_find_the_bottom_and_count_their_steps():
    found = minimise(bowl, Descent.at(START), iterations=100)
    np.testing.assert_allclose((found.best - TRUTH) / (HIGH - LOW), 0, atol=0.02)
    assert found.steps == 100 * 4 * 24
    assert found.best_loss == min(r["loss"] for r in found.history)


def test_as_released_the_density_is_frozen():
    released = minimise(bowl, Descent.at(START), iterations=10, as_released=True)
    assert abs(released.θ[0] - START[0]) <= 10 * 0.1 + 1e-9  # of a range of 440
    ours = minimise(bowl, Descent.at(START), iterations=10)
    assert abs(ours.θ[0] - START[0]) > 50


def test_at_the_top_of_a_range_the_difference_looks_back():
    asked = []

    def uphill(θ):
        asked.append(θ)
        return Score(float(1e-4 * np.sum((θ - LOW) / (HIGH - LOW))))  # falls towards LOW

    found = minimise(uphill, Descent.at(HIGH), iterations=1)
    np.testing.assert_allclose(np.array(asked)[1:].diagonal(), HIGH - DIFFERENCES)
    assert np.all(found.θ < HIGH)
    stuck = minimise(uphill, Descent.at(HIGH), iterations=1, as_released=True)
    np.testing.assert_array_equal(stuck.θ, HIGH)  # the released code's vanishing gradient


def test_values_stay_in_their_ranges():
    found = minimise(lambda θ: Score(float(3.0 - np.sum(θ / HIGH))), Descent.at(START), iterations=60)
    np.testing.assert_allclose(found.θ, HIGH)


def test_a_failed_neighbour_is_taken_on_the_other_side():
    wall = START[1] + 0.01

    def walled(θ):
        return Score(np.inf, ending="stalled") if θ[1] > wall else bowl(θ)

    def mirrored(θ):
        return bowl(θ)

    one, other = (minimise(f, Descent.at(START), iterations=1) for f in (walled, mirrored))
    assert np.sign(one.first[1]) == np.sign(other.first[1])
    assert one.first[1] == pytest.approx(other.first[1], rel=0.1)
    assert one.history[0]["steps"] == 24 * 4  # the neighbour that failed cost nothing here, the one behind did


def test_a_failed_point_is_pulled_back_and_a_hopeless_one_ends_with_the_reason():
    first = minimise(bowl, Descent.at(START), iterations=1)
    wall = START[0] + 8.0
    assert first.θ[0] > wall

    def walled(θ):
        return Score(np.inf, ending="Newton stopped") if θ[0] > wall else bowl(θ)

    pulled = minimise(walled, first, iterations=2)
    assert START[0] < pulled.history[-1]["density"] <= wall
    hopeless = minimise(lambda θ: Score(np.inf, ending="Newton stopped"), first, iterations=2)
    assert "fails wherever" in hopeless.ending and "Newton stopped" in hopeless.ending


def test_the_map_decides_where_the_four_simulations_run():
    serial = minimise(bowl, Descent.at(START), iterations=5)
    with ThreadPoolExecutor(4) as pool:
        spread = minimise(bowl, Descent.at(START), iterations=5, run=pool.map)
    np.testing.assert_array_equal(serial.θ, spread.θ)


def test_algorithm_1_compares_24_frames_after_the_first_with_one_backward_euler_step_each():
    scene = as_algorithm_1(panel(4, frames=30))
    assert len(scene.observed) == FRAMES + 1
    assert (scene.settings.integrator, scene.settings.substeps) == ("backward_euler", 1)
    assert not scene.compared[0].any()


def test_a_panel_comes_nearer_to_what_was_observed():
    truth = Fabric(density=320, membrane=3.0, bending=6.0)
    scene = as_algorithm_1(observed(as_algorithm_1(panel(5, frames=10)), 0, truth=truth))
    heard = []
    found = descend(scene, Fabric(), Descent.at(START), iterations=6, on_iteration=heard.append)
    assert len(heard) == 6
    assert found.best_loss < found.history[0]["loss"]
    resumed = descend(scene, Fabric(), heard[2], iterations=6)
    np.testing.assert_allclose(resumed.θ, found.θ, rtol=1e-6)


def test_an_end_of_a_range_is_no_estimate():
    inside, low, high = Descent.at(START), Descent.at([320.0, 0.1, 1.0]), Descent.at([640.0, 1.0, 8.0])
    assert at_ends(inside) == {}  # nor is the density's, along which nothing is estimated
    assert list(at_ends(low)) == ["log_membrane"] and "lower end of Algorithm 1's range, 0.1 to 8" in at_ends(low)["log_membrane"]
    assert list(at_ends(high)) == ["log_bending"] and "upper end" in at_ends(high)["log_bending"]


def test_every_retry_is_told_with_the_iteration_that_needed_it():
    """Of the point, of its neighbours, and of points that the search turned back from."""
    first = minimise(bowl, Descent.at(START), iterations=1)

    def slow(θ):
        failed = Score(np.inf, ending="Newton stopped", reasons=("far",))
        return failed if θ[0] > START[0] + 8.0 else replace(bowl(θ), reasons=("slow",))

    found = minimise(slow, first, iterations=2)
    assert {*found.reasons} == {"iteration 2: far", "iteration 2: slow"} and first.reasons == ()
    assert found.reasons.count("iteration 2: slow") >= 4


def test_the_fit_by_differences_tells_its_retries_and_the_ends_of_its_ranges(tmp_path, monkeypatch):
    """κ_b best at 8, of which the recording seemed to know; one retry in the search, one in the last replay."""
    scene = observed(as_algorithm_1(panel(4, frames=8)), 0, truth=Fabric(320, 3.0, 100.0))
    best = np.array([320.0, 3.0, 8.0])
    searched = replace(Descent.at(best), history=({"loss": 1.0, "rms_mm": 1.0},), ending="stopped", reasons=("iteration 1: slow",))
    monkeypatch.setattr(stage, "descend", lambda *arguments, **named: searched)
    monkeypatch.setattr(stage, "replay", lambda *arguments, **named: replace(replay(*arguments, **named), reasons=("attempt 1",)))
    monkeypatch.setattr(stage, "knowledge", lambda *arguments, **named: {})
    job = Job("anna", "walk", None, tmp_path, lambda share, text: None, lambda text: None)
    _, found, _ = stage._by_differences(job, Work("panel", scene, Fabric()), FitParameters(method="adam-fd"), map)
    assert found.reasons == ("iteration 1: slow", "attempt 1")
    said = estimates(scene, found)["kappa_b_over_rho"]
    assert said["value"] is said["high"] is None and "upper end of Algorithm 1's range" in said["sentence"]
