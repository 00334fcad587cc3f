"""A panel that swings in air: with the drag in the model its strength is found and another motion is foretold better; without it the fabric
takes the blame.
"""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth.base_refit import BaseFit
from tasks.cloth.completed_replay import replay_completed
from tasks.cloth.estimates import added_effects, estimates
from tasks.cloth.gauss_newton import rms_mm
from tasks.cloth.joint_refit import UNFOLLOWED, CompletedFit, refit_jointly
from tasks.cloth.knowledge import knowledge
from tasks.cloth.nuisances import Prior
from tasks.cloth.scene import replay
from tasks.cloth.shooting import Evidence, Job, about_nearer_start
from tasks.cloth.windowed_fit import Windowed, fit_windows
from tasks.cloth.windows import Normals, Prediction, Window, smooth
from tasks.effects.effect import Motion, Subject
from tasks.effects.library import library
from tasks.effects.model import Model
from tasks.geometry.faults import BadInput
from tasks.simulator import Settings
from tests.cloth.test_gauss_newton import TRUTH, panel

LIBRARY = library()
DRAG, CURVATURE = LIBRARY["air_normal_drag"], LIBRARY["fabric_rest_curvature"]
STRENGTH = 8.0  # [m²/kg]
NOISE = 3e-4  # [m]: in a fifth of a second drag moves this panel by a millimetre
START = replace(TRUTH, membrane=1.5, bending=200.0)


def model(scene, fabric=TRUTH, effects=(DRAG,), **strengths):
    subject = Subject(scene.cloth, fabric, scene.collider, np.full(len(scene.x0), "free"), scene.fps)
    return Model(subject, scene.settings, tuple(effects), strengths or {DRAG.name: np.array([STRENGTH])})


def in_air(scene, seed=0):
    """The scene as observed where its top moves smoothly between frames and the air resists."""
    n = scene.settings.substeps
    fine = replace(model(replace(scene, fps=n * scene.fps)), settings=replace(scene.settings, substeps=1))
    motion = smooth(Motion(scene.collider_motion, scene.boundary_motion), n)
    x = np.stack([frame.x for frame in fine.run(motion, scene.x0, scene.v0)])[::n]
    noise = np.random.default_rng(seed).normal(scale=NOISE, size=x.shape)
    return replace(scene, observed=x + noise, noise_m=np.full(x.shape[:2], NOISE))


def swung_otherwise(scene):
    """Farther and more slowly."""
    t = np.arange(len(scene.observed)) / scene.fps
    path = scene.boundary_motion[:1] + np.stack([0 * t, 0 * t, 0.2 * np.sin(2 * np.pi * 0.8 * t) * np.minimum(1, t / 0.2)], 1)[:, None]
    return in_air(replace(scene, boundary_motion=path), seed=1)


@pytest.fixture(scope="module")
def scene():
    return in_air(replace(panel(5, frames=16), settings=Settings(substeps=4)))


@pytest.fixture(scope="module")
def bare(scene):
    return fit_windows(scene, START)


@pytest.fixture(scope="module")
def completed(scene):
    return fit_windows(scene, START, effects=(DRAG,))


@pytest.mark.parametrize("given", [0.0, 16.0])
def test_it_begins_at_the_strengths_that_the_base_has(given):
    """No iterations, no windows: what comes out went in."""
    own = model(panel(3, frames=4), effects=(), **({DRAG.name: np.array([given])} if given else {"air_wind": np.zeros(2)}))
    base = BaseFit(own, np.eye(2), Prior(1e-3, 1e-2), (), (), "converged")
    begun = refit_jointly(base, [], [DRAG], noise=NOISE, iterations=0).model
    assert begun.effects == (DRAG,) and begun.strength(DRAG) == [given]


@pytest.mark.parametrize(
    "windows",
    [
        [],
        [Evidence(Prediction(Window(0, 0, 3), np.zeros((1, 9, 3)), {}, "stalled", 0), Normals((), np.zeros((0, 0)), np.zeros(0), 0.0, 0))],
    ],
)
def test_where_no_window_can_be_followed_it_stays_and_says_so(windows):
    own = model(panel(3, frames=4), effects=())
    base = BaseFit(own, np.eye(2), Prior(1e-3, 1e-2), (), (), "converged")
    jobs = [Job(own, None, each.prediction.window, None, np.zeros((0, 9))) for each in windows]

    def run(what, todo):
        return [found for _, found in todo] if what is about_nearer_start else windows

    found = refit_jointly(base, jobs, [DRAG], noise=NOISE, iterations=3, run=run)
    assert found.ending == UNFOLLOWED and found.model.strength(DRAG) == own.strength(DRAG)


def test_the_strength_is_found(scene, completed):
    said = estimates(scene, completed)["air_normal_drag"]
    assert said["value"] == pytest.approx(STRENGTH, rel=0.2) and said["unit"] == "m2/kg"
    assert 0 < said["low"] < said["value"] < said["high"]


def test_another_motion_is_foretold_better_with_it(scene, bare, completed):
    other = swung_otherwise(scene)
    before = rms_mm(other, replay(other, bare.fabric))
    after = rms_mm(other, replay_completed(other, replace(completed.model, settings=other.settings)))
    assert after < 0.5 * before


def test_the_replay_is_with_the_effect(scene, completed):
    assert isinstance(completed, CompletedFit) and completed.replay.complete
    without = replay(scene, completed.fabric).x
    assert np.abs(completed.replay.x - without).max() > 5e-3
    again = replay_completed(scene, replace(completed.model, settings=scene.settings)).x
    np.testing.assert_allclose(completed.replay.x, again, atol=1e-12)


def test_the_misfit_falls_below_that_of_the_base(bare, completed):
    alone = [row["misfit"] for row in completed.history if DRAG.name not in row]
    assert completed.history[-1]["misfit"] < 0.5 * min(alone)
    assert completed.history[-1]["rms_mm"] < bare.history[-1]["rms_mm"]


def test_what_is_known_counts_the_strength_among_the_parameters(scene, completed):
    assert completed.normal.A.shape[1:] == (3, 3)
    assert (np.diag(completed.normal.common) > 0).all()  # what a finer computation changes
    told = knowledge(scene, completed, objective=Windowed.of(completed, map))
    assert set(told) == {"gauge", "bootstrap", "half_step"}
    assert told["half_step"]["factors"].keys() == {"kappa_s_over_rho", "kappa_b_over_rho"}


def test_estimates_give_the_effects_back(scene, completed):
    said = estimates(scene, completed)
    effects, strengths = added_effects(said, LIBRARY)
    assert effects == (DRAG,)
    np.testing.assert_array_equal(strengths["air_normal_drag"], completed.model.strengths["air_normal_drag"])
    assert added_effects({k: v for k, v in said.items() if k != "air_normal_drag"}, LIBRARY) == ((), {})
    with pytest.raises(BadInput, match="'air_normal_drag', of no effect that is known"):
        added_effects(said, {})


def test_an_effect_of_several_strengths_has_one_estimate_each(scene, completed):
    two = model(scene, effects=(CURVATURE, DRAG), fabric_rest_curvature=np.array([1.0, -2.0]), air_normal_drag=np.array([25.0]))
    normal = replace(completed.normal, g=np.zeros((2, 5)), A=np.tile(100 * np.eye(5), (2, 1, 1)), common=0.0)
    said = estimates(scene, replace(completed, model=two, normal=normal))
    assert [said[c]["value"] for c in CURVATURE.columns] == [1.0, -2.0]
    half = (said["fabric_rest_curvature.κ₀"]["high"] - said["fabric_rest_curvature.κ₀"]["low"]) / 2
    assert half == pytest.approx(6.314 * 8.0 / np.sqrt(200), rel=1e-3)  # Student's of two windows, a typical strength over what they know
    assert "end of its plausible range" in said["air_normal_drag"]["sentence"]
    assert added_effects(said, LIBRARY)[0] == (DRAG, CURVATURE)  # in the order of the library
