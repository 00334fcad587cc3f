"""A panel that swings from its upper edge: the fabric it was made of is found again, on another mesh and with noise."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth import gauss_newton, perseverance
from tasks.cloth.base_refit import STUCK
from tasks.cloth.estimates import bending_length, estimates
from tasks.cloth.gauss_newton import Normal, Progress, WholeReplay, fit, horizons, loss, normal_equations, turning, within
from tasks.cloth.scene import FORGETFUL, Replay, Scene, replay
from tasks.simulator import NO_COLLIDER, Cloth, Fabric, Settings, simulate
from tests.geometry.test_meshes import grid

TRUTH = Fabric(density=320, membrane=3.0, bending=300.0)


def panel(n: int, *, frames: int = 16) -> Scene:
    """0.2 m square in the x, y plane, held along x at the top and swung along z."""
    x, faces = grid(n, n)
    x = x * (0.2 / (n - 1))
    x[:, 1] -= 0.2
    held = np.flatnonzero(x[:, 1] > -1e-9)
    t = np.arange(frames) / 25.0
    path = x[held][None] + np.stack([0 * t, 0 * t, 0.12 * np.sin(2 * np.pi * 1.3 * t) * np.minimum(1, t / 0.2)], 1)[:, None]
    empty = np.empty((frames, 0, 3))
    shape = (frames, len(x))
    return Scene(
        Cloth(x, faces, held),
        NO_COLLIDER,
        empty,
        path,
        x,
        np.zeros_like(x),
        np.full((*shape, 3), np.nan),
        np.full(shape, 1e-3),
        25.0,
        Settings(substeps=2),
    )


def observed(scene: Scene, seed: int, *, truth: Fabric = TRUTH) -> Scene:
    noise = np.random.default_rng(seed).normal(scale=1e-3, size=scene.observed.shape)
    return replace(scene, observed=replay(scene, truth).x + noise)


@pytest.fixture(scope="module")
def found():
    scene = observed(panel(9), 1)
    return scene, fit(scene, Progress(Fabric(density=320, membrane=1.0, bending=60.0)), iterations=8)


def test_the_fabric_is_found_again(found):
    _, result = found
    assert np.log(result.fabric.membrane / TRUTH.membrane) == pytest.approx(0, abs=0.15)
    assert np.log(result.fabric.bending / TRUTH.bending) == pytest.approx(0, abs=0.15)
    assert result.history[-1]["rms_mm"] == pytest.approx(np.sqrt(3), rel=0.1)  # 1 mm per coordinate is all that is left
    assert result.history[0]["rms_mm"] > 2 * result.history[-1]["rms_mm"]


def test_only_ratios_to_the_density_are_found(found):
    scene, result = found
    heavy = Fabric(density=640, membrane=2.0, bending=120.0)
    other = fit(scene, Progress(heavy), iterations=8)
    assert other.fabric.membrane / 640 == pytest.approx(result.fabric.membrane / 320, rel=1e-2)


def test_bending_finer_than_the_mesh_is_called_insensitive(found):
    scene, result = found
    stiff = estimates(scene, result)["kappa_b_over_rho"]
    assert stiff["low"] < stiff["value"] < stiff["high"]
    limp = replace(result, fabric=replace(result.fabric, bending=1.0))
    assert bending_length(limp.fabric) < 0.01
    said = estimates(scene, limp)["kappa_b_over_rho"]
    assert said["value"] is None
    assert "insensitive" in said["sentence"]


def test_a_fit_that_was_stopped_goes_on_where_it_was(found):
    scene, result = found
    heard = []
    fit(scene, Progress(Fabric(density=320, membrane=1.0, bending=60.0)), iterations=2, on_iteration=heard.append)
    resumed = fit(scene, heard[-1], iterations=8)
    assert len(resumed.history) == len(result.history)
    np.testing.assert_allclose(resumed.replay.x, result.replay.x, rtol=1e-6, atol=1e-9)


def test_ninety_per_cent_hold_where_blocks_are_few():
    """Scores of four blocks drawn from one distribution: nine of ten intervals hold the truth, the normal quantile alone would hold fewer."""
    rng = np.random.default_rng(0)
    A = np.tile(np.diag([2e3, 5e3]), (4, 1, 1))  # whose own noise is negligible beside the blocks'
    held = {"student": 0, "normal": 0}
    for _ in range(1000):
        normal = Normal(1e3 * rng.standard_normal((4, 2)), A)
        off, deviation = abs(normal.step[0]), np.sqrt(normal.covariance[0, 0])
        held["student"] += off < normal.quantile * deviation
        held["normal"] += off < 1.645 * deviation
    assert held["student"] / 1000 == pytest.approx(0.9, abs=0.03)
    assert held["normal"] / 1000 < 0.86


def test_one_stretch_of_frames_gives_no_interval(found):
    scene, result = found
    one = replace(result, normal=Normal(result.normal.g[:1], result.normal.A[:1]))
    said = estimates(scene, one)["kappa_b_over_rho"]
    assert said["value"] is None
    assert "give twice as many frames" in said["sentence"]


def test_a_step_that_one_parameter_may_not_take_is_asked_of_the_other():
    """Both stiffen alike: where κ_s may move by no more than its bound, the minimum within the box lies at a larger κ_b than that of the step cut off."""
    A, g = np.array([[4.0, 1.8], [1.8, 1.0]]), np.array([10.0, 4.6])
    cut, step = np.clip(np.linalg.solve(A, g), -1.2, 1.2), within(A, g, 1.2)
    corners = np.stack(np.meshgrid(np.linspace(-1.2, 1.2, 241), np.linspace(-1.2, 1.2, 241)), -1).reshape(-1, 2)
    model = [0.5 * s @ A @ s - g @ s for s in (step, cut, *corners)]
    assert model[0] < model[1] - 0.01 and model[0] <= min(model[2:]) + 1e-9
    np.testing.assert_allclose(within(A, 0.01 * g, 1.2), np.linalg.solve(A, 0.01 * g))


def test_the_whole_goes_on_where_the_first_third_of_a_second_ended(monkeypatch):
    scene, begun, replays = observed(panel(5, frames=21), 1), [], []

    def stepping(*arguments, **named):
        for frame in simulate(*arguments, **named):
            begun.extend([frame.index] * (frame.index == 0))
            yield frame

    def counted(*arguments, **named):
        replays.append(len(arguments[0].observed))
        return replay(*arguments, **named)

    monkeypatch.setattr(perseverance, "simulate", stepping)
    monkeypatch.setattr(gauss_newton, "replay", counted)
    heard = []
    found = fit(scene, Progress(Fabric(density=320, membrane=1.0, bending=60.0)), iterations=2, on_iteration=heard.append)
    assert len(begun) == len(replays) - 1 and set(replays) == {9, 21}  # the first replay of the whole was not begun anew
    lengths = [row["frames"] for row in found.history]
    assert horizons(21, 25.0) == (9, 21) and set(lengths) == {9, 21} and lengths == sorted(lengths)
    whole = replay(scene, found.fabric, tangents=("log_membrane", "log_bending"))
    np.testing.assert_array_equal(found.replay.x, whole.x)
    np.testing.assert_array_equal(found.replay.columns["log_bending"], whole.columns["log_bending"])
    for stopped in heard:
        resumed = fit(scene, stopped, iterations=2)
        np.testing.assert_array_equal(resumed.replay.x, found.replay.x)
        assert resumed.history == found.history and resumed.ending == found.ending


def test_a_recording_of_few_frames_has_one_horizon():
    assert horizons(18, 25.0) == (18,)


def seen_from(scene, size, seed=0):
    """A replay that misses every compared coordinate by `size` [n] standard deviations, with made-up columns."""
    x, rng = np.where(np.isfinite(scene.observed), scene.observed, 0.0), np.random.default_rng(seed)
    x[scene.compared] -= (size * scene.noise_m[scene.compared])[:, None]
    return Replay(x, {name: 1e-3 * rng.standard_normal(x.shape) for name in gauss_newton.PARAMETERS}, 0, "converged")


@pytest.fixture(scope="module")
def still():
    """100 vertices that are compared in one frame."""
    scene = panel(11, frames=2)
    scene = replace(scene, observed=np.broadcast_to(scene.x0, scene.observed.shape).copy())
    scene.observed[1, np.flatnonzero(scene.compared[1])[100:]] = np.nan
    return scene


def test_the_loss_is_hubers_and_outliers_that_get_worse_count(still, monkeypatch):
    """90 misfits from 4.0 to 3.9, ten from 100 to 102: with δ = 10 their loss rises, Σ w r² would fall and its δ with them."""
    before, after = (seen_from(still, np.repeat(sizes, (90, 10))) for sizes in ((4.0, 100.0), (3.9, 102.0)))
    δ = turning(still, before)
    assert δ == pytest.approx(10.0)
    assert loss(still, before, δ) == pytest.approx(3 * (0.9 * 4.0**2 + 0.1 * (2 * 10 * 100 - 10**2)))
    assert loss(still, after, δ) == pytest.approx(3 * (0.9 * 3.9**2 + 0.1 * (2 * 10 * 102 - 10**2)))
    assert loss(still, after, δ) > loss(still, before, δ)
    monkeypatch.setattr(gauss_newton, "replay", lambda *arguments, **named: after)
    stayed, _ = gauss_newton._iterate(still, Progress(TRUTH), before, 1, FORGETFUL)
    assert stayed.fabric == TRUTH and "no shorter step" in stayed.ending


def test_steps_that_cannot_be_simulated_are_no_convergence(still, monkeypatch):
    at = seen_from(still, np.ones(100))
    fails = replace(at, ending="Newton stopped after 100 iterations")
    monkeypatch.setattr(gauss_newton, "replay", lambda *arguments, **named: fails)
    stayed, _ = gauss_newton._iterate(still, Progress(TRUTH), at, 3, FORGETFUL)
    assert stayed.ending.startswith(STUCK) and "Newton stopped after 100 iterations" in stayed.ending


def test_normal_equations_hold_its_gradient(still):
    """dL/dθ = −2 g/n, with misfits on both sides of where it turns."""
    size = np.random.default_rng(1).uniform(1.0, 4.0, 100) * np.repeat([1.0, 10.0], (80, 20))
    at, ε = seen_from(still, size), 1e-6
    δ, slopes = turning(still, at), []
    assert (size < δ).any() and (size > δ).any()
    for name in gauss_newton.PARAMETERS:
        above, below = (loss(still, replace(at, x=at.x + s * ε * at.columns[name]), δ) for s in (1, -1))
        slopes.append((above - below) / (2 * ε))
    np.testing.assert_allclose(slopes, -2 * normal_equations(still, at).g.sum(0) / 100, rtol=1e-6)


def test_losses_that_are_compared_turn_where_the_first_does(still, monkeypatch):
    sizes = {1.0: (4.0, 100.0), 2.0: (8.0, 100.0)}
    monkeypatch.setattr(gauss_newton, "replay", lambda scene, fabric: seen_from(still, np.repeat(sizes[fabric.membrane], (90, 10))))
    first, second = WholeReplay().losses(still, [replace(TRUTH, membrane=1.0), replace(TRUTH, membrane=2.0)])
    assert second - first == pytest.approx(3 * 0.9 * (8.0**2 - 4.0**2))  # the outliers have not moved
