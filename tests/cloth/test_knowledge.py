"""What is said to be known: the gauge is flat, the profile has its bottom at the optimum, intervals behave, choices show."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth.base_parameters import BOUNDS, moved
from tasks.cloth.estimates import at_bound, estimates
from tasks.cloth.gauss_newton import Normal, Progress, WholeReplay, fit
from tasks.cloth.knowledge import bootstrap, choices, gauge, intervals, knowledge, profile
from tasks.cloth.stage import FitParameters, Work, _by_tangents, _by_whole_replay
from tasks.cloth.windowed_fit import Windowed
from tasks.simulator import Fabric
from tasks.stage import Job
from tests.cloth.test_gauss_newton import TRUTH, observed, panel
from tests.cloth.test_windowed_fit import FAR


@pytest.fixture(scope="module")
def found():
    scene = observed(panel(8, frames=10), 3)
    return scene, fit(scene, Progress(Fabric(density=320, membrane=2.0, bending=150.0)), iterations=10)


def test_the_loss_is_flat_along_the_gauge(found):
    scene, result = found
    rows = gauge(scene, result.fabric)["profile"]
    assert [r["factor"] for r in rows] == [1.0, 0.5, 2.0]
    np.testing.assert_allclose([r["loss"] for r in rows], rows[0]["loss"], rtol=1e-6)


def test_the_profile_rises_on_both_sides_and_as_the_normal_matrix_says(found):
    scene, result = found
    rows = profile(scene, result, 1, offsets=(-40.0, 40.0))
    assert rows[1]["rise"] == 0.0
    assert rows[0]["rise"] > 0 and rows[2]["rise"] > 0
    assert rows[0]["value"] < rows[1]["value"] < rows[2]["value"]


def test_the_bootstrap_spreads_as_the_sandwich_does():
    rng = np.random.default_rng(0)
    A = np.tile(np.diag([2.0, 5.0]) * 10, (40, 1, 1))
    normal = Normal(rng.normal(size=(40, 2)), A)
    steps = bootstrap(normal)
    sandwich = normal.covariance - np.linalg.inv(A.sum(0))
    np.testing.assert_allclose(steps.std(0), np.sqrt(np.diag(sandwich)), rtol=0.15)
    np.testing.assert_allclose(steps.mean(0), 0, atol=3 * steps.std(0).max() / np.sqrt(len(steps)))
    wide = intervals(Fabric(), steps)["kappa_s_over_rho"]
    assert wide["low"] < 1 / 320 < wide["high"]


def test_of_a_single_block_nothing_is_drawn(found):
    scene, result = found
    one = replace(result, normal=Normal(result.normal.g.sum(0)[None], result.normal.A.sum(0)[None]))
    assert set(knowledge(scene, one)) == {"gauge", "half_step"}


def test_an_end_that_a_linear_step_cannot_tell_is_none():
    """By hand: a factor of 2 is told, one of 100 is not, nor is one that no float holds."""
    steps = np.log(np.array([[2.0, 0.5], [2.0, 100.0]]))
    assert intervals(Fabric(), steps[[0, 0]])["kappa_s_over_rho"]["high"] == pytest.approx(2 / 320)
    assert intervals(Fabric(), steps[[1, 1]])["kappa_b_over_rho"] == {"low": None, "high": None, "unit": "m3/kg"}
    assert intervals(Fabric(), np.array([[-1.0, 0.0], [1e4, 0.0]]))["kappa_s_over_rho"]["high"] is None


def test_half_the_step_changes_what_backward_euler_made_of_it(found):
    scene, _ = found
    coarse = replace(scene, settings=replace(scene.settings, integrator="backward_euler", substeps=1))
    blurred = fit(coarse, Progress(TRUTH), iterations=4)
    fine = replace(scene, settings=replace(scene.settings, substeps=4))
    ours = fit(fine, Progress(TRUTH), iterations=4)
    size = lambda f, s: max(abs(np.log(factor or 10)) for factor in choices(s, f)["half_step"]["factors"].values())  # noqa: E731
    assert size(ours, fine) < size(blurred, coarse)


def test_the_density_is_reported_only_when_weighed(found):
    scene, result = found
    said = estimates(scene, result)["density"]
    assert said["value"] is None and "any c > 0" in said["sentence"]
    assert estimates(scene, result, weighed=True)["density"]["value"] == result.fabric.density


def test_plain_units_and_ratios_are_the_same_fabric(found):
    scene, result = found
    e = estimates(scene, result)
    assert e["stretch_over_areal_density"]["value"] == pytest.approx(result.fabric.stretch_stiffness / result.fabric.areal_density)
    assert e["bending_over_areal_density"]["value"] == pytest.approx(result.fabric.bending_rigidity / result.fabric.areal_density)
    for a, b in (("kappa_s_over_rho", "stretch_over_areal_density"), ("kappa_b_over_rho", "bending_over_areal_density")):
        assert e[a]["high"] / e[a]["low"] == pytest.approx(e[b]["high"] / e[b]["low"])


def test_a_parameter_at_its_bound_and_one_without_data_are_said_to_be(found):
    scene, result = found
    stiff, _ = moved(result.fabric, np.array([99.0, 0.0]))
    assert stiff.membrane == pytest.approx(np.exp(BOUNDS["log_membrane"][1]))
    assert "upper bound" in at_bound(stiff, "log_membrane")
    assert at_bound(result.fabric, "log_membrane") == ""
    dead = replace(result, normal=Normal(result.normal.g * [0, 1], result.normal.A * [[0, 0], [0, 1]]))
    assert "untouched" in estimates(scene, dead)["kappa_s_over_rho"]["sentence"]
    assert estimates(scene, dead)["kappa_b_over_rho"]["value"] is not None


def test_everything_is_json(found):
    import json

    scene, result = found
    told = json.loads(json.dumps(knowledge(scene, result, otherwise=scene.boundary_motion)))
    assert set(told) == {"gauge", "bootstrap", "half_step", "other_boundary"}
    assert told["other_boundary"]["factors"]["kappa_s_over_rho"] == pytest.approx(1.0, abs=1e-6)
    failed = replace(result, normal=Normal(np.full((1, 2), np.nan), np.full((1, 2, 2), np.nan)))
    assert set(knowledge(scene, failed)) == {"gauge"}


@pytest.mark.parametrize(("fitted", "method"), [(_by_tangents, "gauss-newton"), (_by_whole_replay, "whole-replay")])
def test_a_boundary_that_is_the_same_changes_nothing(tmp_path, fitted, method):
    """Neither the step that windows of another length took, nor a start that the fit has not had, is told as the boundary's doing."""
    scene = observed(panel(6, frames=11), 5)
    work = Work("garment", replace(scene, x0=scene.observed[0]), FAR, otherwise=scene.boundary_motion)
    job = Job("anna", "walk", None, tmp_path, lambda share, text: None, lambda text: None)
    told = fitted(job, work, FitParameters(method=method, iterations=4), map)[2]["other_boundary"]
    assert list(told["factors"].values()) == pytest.approx([1.0, 1.0], abs=1e-9)


@pytest.mark.parametrize("objective", [WholeReplay(), Windowed()])
def test_a_boundary_that_is_another_changes_what_it_changes(found, objective):
    """Nothing where nothing is changed, though the fit stopped before its optimum; a swing wider by 1 in 500 what it alone asks for."""
    scene, result = found
    early = replace(result, fabric=moved(result.fabric, np.array([0.3, -0.2]))[0])
    left = objective.normal(scene, early.fabric).step
    wider = scene.boundary_motion[:1] + 1.002 * (scene.boundary_motion - scene.boundary_motion[:1])
    asked = objective.normal(replace(scene, boundary_motion=wider), early.fabric).step - left
    same, other = (choices(scene, early, objective, path)["other_boundary"]["factors"] for path in (scene.boundary_motion, wider))
    assert np.abs(left).max() > 0.1 and np.abs(asked).max() > 0.01
    assert list(same.values()) == pytest.approx([1.0, 1.0], abs=1e-9)
    assert np.log(list(other.values())) == pytest.approx(asked)


def test_the_noise_is_the_fits(found):
    """Where windows showed it to be a tenth of what the file stated, everything is told with a tenth."""
    scene, result = found
    heard = []

    class Listening(WholeReplay):
        def normal(self, scene, fabric):
            heard.append(scene.noise_m)
            return super().normal(scene, fabric)

    knowledge(scene, replace(result, noise_share=0.1), objective=Listening(), otherwise=scene.boundary_motion)
    assert len(heard) == 3
    np.testing.assert_allclose(heard, np.broadcast_to(0.1 * scene.noise_m, (3, *scene.noise_m.shape)))
