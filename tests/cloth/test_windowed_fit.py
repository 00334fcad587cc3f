"""Windows find the fabric from far away, like the truth better than its neighbours, and start where forces allow."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth import windowed_fit
from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.estimates import estimates
from tasks.cloth.gauss_newton import UNKNOWN
from tasks.cloth.knowledge import knowledge
from tasks.cloth.numerics import corrected
from tasks.cloth.scene import replay
from tasks.cloth.windowed_fit import Windowed, fit_windows, started_well
from tasks.effects.library import library
from tasks.simulator import Fabric
from tasks.simulator.newton import CONVERGED
from tests.cloth.test_gauss_newton import TRUTH, observed, panel

FAR = Fabric(density=320, membrane=1.0, bending=80.0)


@pytest.fixture(scope="module")
def scene():
    return observed(panel(6, frames=11), 5)


def test_the_fabric_is_found_from_far_away(scene):
    found = fit_windows(started_well(scene, FAR), FAR)
    assert np.log(found.fabric.bending / TRUTH.bending) == pytest.approx(0, abs=0.35)
    assert np.abs(np.log(found.fabric.bending / TRUTH.bending)) < 0.3 * np.log(TRUTH.bending / FAR.bending)
    assert len(found.normal.g) == 2  # windows
    assert found.history[-1]["rms_mm"] < 10


def test_windows_like_the_truth_better_than_its_neighbours(scene):
    truth, *beside = Windowed().losses(scene, [replace(TRUTH, bending=factor * TRUTH.bending) for factor in (1.0, 0.6, 1.6)])
    assert min(beside) > truth


def test_a_noisy_start_is_pulled_towards_what_the_forces_allow(scene):
    x = panel(6).x0
    before, after = (1e3 * np.sqrt(np.mean((s.x0 - x) ** 2)) for s in (replace(scene, x0=scene.observed[0]), started_well(scene, TRUTH)))
    assert after < 0.8 * before


def test_what_the_computation_does_is_taken_off_at_the_end(scene):
    """Of windows with what a finer mesh and half the step add only the fabric's two columns are left, and the doubt that all of them share."""
    jobs = windowed_fit._cut(scene, TRUTH).jobs
    found = windowed_fit.refit(jobs, noise=1e-3, iterations=0)
    finer = windowed_fit._with_offsets(found, jobs, map)
    for job, told in zip(finer, windowed_fit._following_finely(found, finer, map)([TRUTH])[0], strict=True):
        assert len(job.offsets) == 2
        assert corrected(told).names == PARAMETERS
    _, normal, reasons = windowed_fit._less_numerics(found, jobs, map)
    assert reasons == ()
    assert (np.diag(normal.common) > 0).all()
    assert (normal.half_width > normal.quantile * np.sqrt(np.diag(normal.covariance - normal.common))).all()


def test_noise_that_is_overstated_hides_nothing():
    """A recording without errors, said to have some of a millimetre: within them any fabric explains it."""
    scene = panel(5, frames=5)
    x = replay(scene, TRUTH).x
    found = fit_windows(started_well(replace(scene, observed=x, noise_m=np.full(x.shape[:2], 1e-3)), FAR), FAR)
    assert np.log(found.fabric.bending / TRUTH.bending) == pytest.approx(0, abs=0.1)
    assert np.log(found.fabric.membrane / TRUTH.membrane) == pytest.approx(0, abs=0.3)
    assert found.history[-1]["rms_mm"] < 0.5
    assert found.noise_share < 0.5  # what else is told of it is told with the noise that it was fitted with


@pytest.mark.parametrize("stuck", ["at its states", "in one of its windows", "not predicted"])
def test_where_longer_windows_cannot_be_followed_the_short_ones_stand(scene, monkeypatch, stuck):
    as_cut = windowed_fit._cut

    def only_short(scene, fabric, length_s=None):
        cut = as_cut(scene, fabric, length_s)
        if length_s is not None:
            return cut
        first = cut.jobs[0]
        if stuck == "not predicted":  # observed two centimetres from where any cloth goes
            off = replace(first.recording, observed=first.recording.observed + 0.02)
            return replace(cut, jobs=[replace(job, recording=off) for job in cut.jobs])
        settings = replace(first.model.settings, newton_iterations=1, halvings=0)
        lost = replace(first, model=replace(first.model, settings=settings))
        return replace(cut, jobs=[] if stuck == "at its states" else [lost, *cut.jobs[1:]])

    monkeypatch.setattr(windowed_fit, "_cut", only_short)
    found = fit_windows(started_well(scene, FAR), FAR)
    assert len(found.normal.g) == 2 and np.isfinite(found.covariance).all()
    assert np.log(found.fabric.bending / TRUTH.bending) == pytest.approx(0, abs=0.35)


def test_windows_without_a_finer_computation_are_counted(scene, monkeypatch):
    jobs = windowed_fit._cut(scene, TRUTH).jobs
    found = windowed_fit.refit(jobs, noise=1e-3, iterations=0)
    finer = windowed_fit._finer
    monkeypatch.setattr(windowed_fit, "_finer", lambda job: finer(job) if job.window.start else {})
    _, normal, reasons = windowed_fit._less_numerics(found, jobs, map)
    assert reasons == (f"1 of {len(jobs)} windows have no finer computation",)
    assert len(normal.g) == len(jobs) - 1 and (np.diag(normal.common) > 0).all()


def test_where_the_finer_one_loses_the_windows_aside_nothing_is_said_to_be_known(scene, monkeypatch):
    jobs = windowed_fit._cut(scene, TRUTH).jobs
    found = windowed_fit.refit(jobs, noise=1e-3, iterations=0)
    monkeypatch.setattr(windowed_fit, "bracketed", lambda fabric, follow: None)
    fabric, normal, reasons = windowed_fit._less_numerics(found, jobs, map)
    assert fabric == TRUTH and reasons == (UNKNOWN,) and np.isnan(normal.half_width).all()


def test_without_any_finer_computation_there_is_no_interval(scene, monkeypatch):
    monkeypatch.setattr(windowed_fit, "_finer", lambda job: {})
    found = fit_windows(started_well(scene, FAR), FAR)
    assert found.reasons == ("2 of 2 windows have no finer computation", UNKNOWN)
    said = estimates(scene, found)
    for key in ("kappa_s_over_rho", "kappa_b_over_rho"):
        assert said[key]["value"] is said[key]["low"] is said[key]["high"] is None
        assert UNKNOWN in said[key]["sentence"]
    assert set(knowledge(scene, found, objective=Windowed())) == {"gauge"}  # nor one by the bootstrap


def test_strengths_are_not_fitted_without_a_finer_computation_and_that_is_said(scene, monkeypatch):
    cut = windowed_fit._cut(scene, TRUTH)
    found, jobs = windowed_fit.refit(cut.jobs, noise=1e-3, iterations=0), cut.jobs
    monkeypatch.setattr(windowed_fit, "_finer", lambda job: {})
    bare = windowed_fit._completed(scene, found, cut, (library()["air_normal_drag"],), 1, map, lambda text: None)
    assert bare.reasons == (f"{len(jobs)} of {len(jobs)} windows have no finer computation",)


def test_a_stretch_in_which_the_garment_was_lost_is_left_out_and_that_is_said():
    """Frames 4 to 8 of 12, all but the driven nodes: one of three windows compares nothing."""
    scene = observed(panel(4, frames=13), 0)
    lost = scene.observed.copy()
    lost[4:9, np.setdiff1d(np.arange(16), scene.cloth.boundary)] = np.nan
    found = fit_windows(replace(scene, observed=lost), TRUTH, iterations=1)
    assert "1 of 3 windows are left out: hardly anything was seen in them" in found.reasons
    assert len(found.normal.g) == 2 and np.isfinite(found.normal.A).all()


def walk_ends(monkeypatch, at: int) -> None:
    """The walk through the states of any scene ends at that frame."""
    walk = windowed_fit.states

    def cut_short(model, motion, observed, noise):
        known = walk(model, motion, observed, noise)
        return replace(known, x=known.x[:at], v=known.v[:at], ending=f"frame {at}: Newton stopped")

    monkeypatch.setattr(windowed_fit, "states", cut_short)


def test_windows_after_the_end_of_the_walk_are_left_out_and_that_is_said(monkeypatch):
    scene = observed(panel(4, frames=13), 0)
    assert windowed_fit._cut(scene, TRUTH, 0.18).ending == CONVERGED and windowed_fit._cut(scene, TRUTH, 0.18).reasons == ()
    walk_ends(monkeypatch, 8)
    found = fit_windows(scene, TRUTH, iterations=1)
    (said,) = [reason for reason in found.reasons if "frame 8: Newton stopped" in reason]
    assert "1 of 3 windows begin later and are left out" in said and len(found.normal.g) == 2


@pytest.mark.parametrize("at", [1, 8])
def test_a_loss_of_other_windows_is_none(monkeypatch, at):
    scene = observed(panel(4, frames=13), 0)
    walk_ends(monkeypatch, at)
    assert np.isnan(Windowed().losses(scene, [TRUTH])).all()
