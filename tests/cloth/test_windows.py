"""Windows of multiple shooting: what they cover, what they predict, their derivatives, and the base refit on a twin."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth import base_refit
from tasks.cloth import windows as cloth_windows
from tasks.cloth.base_parameters import PARAMETERS, moved, with_fabric
from tasks.cloth.base_refit import STUCK, refit, stretch_of
from tasks.cloth.likeliest_errors import estimated_prior
from tasks.cloth.nuisances import Prior
from tasks.cloth.shooting import Job, about_nearer_start, follow, follow_corrected, follow_nearer, nearer_start
from tasks.cloth.start_state import States, derivative, filled, shrunken, states, told_by_two
from tasks.cloth.state_modes import smooth_modes, state_columns
from tasks.cloth.tracking_noise import Correlation
from tasks.cloth.windows import Normals, Recording, Window, marginalised, predict, windows
from tasks.effects.effect import Motion, Subject
from tasks.effects.library import library
from tasks.effects.model import Model
from tasks.effects.observation_smoothing import EFFECT as SMOOTHING
from tasks.geometry.farthest_points import farthest_points
from tasks.simulator import NO_COLLIDER, Cloth, Collider, Fabric, Settings
from tests.simulator.scenes import sheet

LIBRARY = library()
FPS = 30.0
FABRIC = Fabric(450.0, 6.0, 150.0)
OF_NOISE = Prior(1e-3 / 7, 0.5e-3 / 7 * FPS)  # what white errors of a millimetre at 49 vertices leave of a mode


def swung(T: int, *, fabric=FABRIC, noise=0.0, seed=0):
    """A hanging panel whose upper edge sways: model, recording (as simulated), true velocities [T, V, 3]."""
    x, faces = sheet(7, 7, length=0.4, width=0.4)
    x = x[:, [1, 0, 2]] * (1, -1, 1)  # hangs from its first row
    cloth = Cloth(x, faces, np.arange(7))
    n, settle = 4, 30
    t = np.arange((T + settle - 1) * n + 1) / (FPS * n) - settle / FPS
    shift = np.where(t > 0, 0.05 * (1 - np.cos(2 * np.pi * 1.2 * t)), 0.0)
    boundary = x[None, :7] + shift[:, None, None] * (0, 0, 1) + shift[:, None, None] * (1, 0, 0)
    subject = Subject(cloth, fabric, NO_COLLIDER, np.full(49, "free"), FPS * n)
    motion = Motion(np.zeros((len(t), 0, 3)), boundary)
    frames = list(Model(subject, Settings(substeps=1)).run(motion, x, np.zeros_like(x)))[settle * n :: n]
    y, v = np.stack([f.x for f in frames]), np.stack([f.v for f in frames])
    observed = y + noise * np.random.default_rng(seed).standard_normal(y.shape)
    own = Motion(np.zeros((T, 0, 3)), boundary[settle * n :: n])
    return (
        Model(replace(subject, fps=FPS), Settings(substeps=4)),
        Recording(subject.collider, own, observed, np.full(y.shape[:2], max(noise, 1e-4))),
        y,
        v,
    )


@pytest.fixture(scope="module")
def panel():
    return swung(25, noise=1e-3)


def test_velocities_told_by_two_frames_lose_what_noise_makes_of_them():
    model, recording, x, v = swung(15, noise=3e-3)
    cloth, error = model.subject.cloth, {}
    noisy = recording.observed.copy()
    noisy[:, cloth.boundary] = x[:, cloth.boundary]  # what drives the cloth is known
    for name, y in (("noisy", noisy), ("exact", x)):
        between = FPS * (y[9] - y[8])
        told = told_by_two(between, between, cloth, FPS, 3e-3 if name == "noisy" else 0.0)
        error[name] = [float(np.sqrt(np.mean((each - v[8:10].mean(0)) ** 2))) for each in (told, between)]
    assert error["noisy"][0] < 0.6 * error["noisy"][1]
    assert error["exact"][0] == pytest.approx(error["exact"][1], rel=1e-6)  # where there is no noise nothing is lost


def test_windows_cover_every_recording_once(panel):
    _, recording, *_ = panel
    cut = windows([recording, recording.cut(slice(0, 13))], FPS)
    for k, last in ((0, 24), (1, 12)):
        own = [w for w in cut if w.recording == k]
        assert own[0].start == 0 and own[-1].start + own[-1].length == last
        assert all(a.start + a.length == b.start for a, b in itertools.pairwise(own))


def test_a_window_in_which_hardly_anything_was_seen_is_left_out(panel):
    """Frames 6 to 19 of 24 show nothing, or the driven nodes alone; two more vertices in one of them are enough."""
    model, recording, *_ = panel
    driven = model.subject.cloth.boundary
    lost, held = recording.observed.copy(), recording.observed.copy()
    lost[6:20] = np.nan
    held[6:20, np.setdiff1d(np.arange(49), driven)] = np.nan
    glimpse = held.copy()
    glimpse[14, 40:42] = 0.0
    for seen, starts in ((lost, [0, 19]), (held, [0, 19]), (glimpse, [0, 10, 19])):
        assert [w.start for w in windows([replace(recording, observed=seen)], FPS)] == starts


def test_states_are_nearer_the_truth_than_what_was_observed(panel):
    model, recording, x, v = panel
    found = states(model, recording.motion, recording.observed, 1e-3)
    free = np.arange(7, 49)
    raw = recording.observed - x
    assert found.ending == "converged"
    assert np.sqrt(np.mean((found.x - x)[:, free] ** 2)) < 0.8 * np.sqrt(np.mean(raw[:, free] ** 2))
    two = np.gradient(recording.observed, 1 / FPS, axis=0)
    assert np.sqrt(np.mean((found.v - v)[3:-3] ** 2)) < np.sqrt(np.mean((two - v)[3:-3] ** 2))


def test_what_a_simulation_that_ends_early_reached_is_told_as_the_tracker_would(monkeypatch):
    model, recording, x, v = swung(9)
    run_along = Model.run_along
    monkeypatch.setattr(Model, "run_along", lambda *a, **k: itertools.islice(run_along(*a, **k), 21))  # five frames and a step
    monkeypatch.setattr(type(SMOOTHING), "observe", lambda self, subject, x, θ: x + 1.0)
    found = predict(model.joined([SMOOTHING], {}), recording, Window(0, 0, 8), States(x, v, "converged"))
    assert len(found.x) == 6 and not found.complete
    np.testing.assert_array_equal(found.x[0], x[0] + 1.0)


def test_gaps_are_filled_in_time_and_over_the_mesh(panel):
    model, _recording, x, _ = panel
    y = x.copy()
    y[5:8, 20] = np.nan
    y[:, 30] = np.nan
    whole, seen = filled(y, model.subject.cloth.faces)
    assert np.isfinite(whole).all() and not seen[6, 20] and not seen[:, 30].any()
    assert np.abs(whole[6, 20] - x[6, 20]).max() < 0.01
    assert np.abs(whole[:, 30] - x[:, 30]).max() < 0.03


def test_of_many_vertices_some_are_compared_as_if_the_others_had_not_been_seen(panel, monkeypatch):
    model, recording, *_ = panel
    lasting = replace(recording, correlation=Correlation(0.6, 0.1, 0.08))
    found = states(model, recording.motion, recording.observed, 1e-3)
    window = windows([recording], FPS)[0]
    predicted = predict(model, recording, window, found, φ=smooth_modes(model.subject.cloth, 2))
    monkeypatch.setattr(cloth_windows, "COMPARED", 12)
    few = cloth_windows.normals(predicted, lasting, model.subject)
    monkeypatch.setattr(cloth_windows, "COMPARED", 1000)
    free = np.arange(7, 49)
    others = np.setdiff1d(free, free[farthest_points(model.subject.cloth.x_rest[free], 12)])
    unseen = recording.observed.copy()
    unseen[:, others] = np.nan
    told = cloth_windows.normals(predicted, replace(lasting, observed=unseen), model.subject)
    assert few.n == told.n == 3 * 12 * window.length
    np.testing.assert_allclose(few.G, told.G, rtol=1e-9)
    np.testing.assert_allclose((few.c, few.logdet), (told.c, told.logdet), rtol=1e-9)


def test_derivatives_of_a_parabola_are_exact():
    t = np.arange(9)[:, None, None] / FPS
    np.testing.assert_allclose(derivative(1 + 2 * t + 3 * t**2, FPS, 1), 2 + 6 * t, rtol=1e-9)
    np.testing.assert_allclose(derivative(1 + 2 * t + 3 * t**2, FPS, 2), np.full_like(t, 6.0), rtol=1e-8)


def test_a_fast_smooth_swing_keeps_its_velocity_and_noise_does_not_become_one():
    cloth = swung(2)[0].subject.cloth
    φ = smooth_modes(cloth, 8)
    t = np.arange(20)[:, None, None] / FPS
    swing = 0.05 * np.sin(2 * np.pi * 3 * t) * φ[0][:, None]
    true = 0.05 * 2 * np.pi * 3 * np.cos(2 * np.pi * 3 * t) * φ[0][:, None]
    noise = 1e-3 * np.random.default_rng(0).standard_normal((20, 49, 3))

    def rms(v):
        return np.sqrt(np.mean((v - true) ** 2))

    def found(x):
        return shrunken(x, cloth, FPS, 1, 1e-3)

    assert rms(found(swing + noise)) < 0.5 * rms(derivative(swing + noise, FPS, 1))  # the parabola rounds the swing off
    assert rms(found(swing + noise)) < 0.8 * rms(derivative(swing + noise, FPS, 1, 4))  # order 4 follows the noise
    np.testing.assert_allclose(shrunken(swing, cloth, FPS, 1, 0.0), derivative(swing, FPS, 1, 4), atol=1e-12)


def test_modes_are_orthonormal_and_vanish_where_driven(panel):
    cloth = panel[0].subject.cloth
    φ = smooth_modes(cloth, 12)
    gram = φ * cloth.vertex_areas @ φ.T / cloth.vertex_areas.sum()
    np.testing.assert_allclose(gram, np.eye(12), atol=1e-8)
    assert not φ[:, cloth.boundary].any()


def test_columns_are_the_derivatives_of_the_prediction(panel):
    model, recording, x, v = panel
    window, φ = Window(0, 8, 4), smooth_modes(model.subject.cloth, 2)
    start = States(x, v, "converged")
    found = predict(model, recording, window, start, parameters=PARAMETERS, φ=φ)
    e = 1e-4
    for name in ("log_membrane", "log_bending"):
        field = {"log_membrane": "membrane", "log_bending": "bending"}[name]
        sides = [
            predict(with_fabric(model, replace(FABRIC, **{field: getattr(FABRIC, field) * np.exp(s)})), recording, window, start).x
            for s in (e, -e)
        ]
        slope = (sides[0] - sides[1])[1:] / (2 * e)
        assert np.linalg.norm(found.columns[name] - slope) < 1e-3 * np.linalg.norm(slope)
    dx, dv = state_columns(φ)["v 1 y"]
    sides = [predict(model, recording, window, States(x + s * dx, v + s * dv, "converged")).x for s in (e, -e)]
    slope = (sides[0] - sides[1])[1:] / (2 * e)
    assert np.linalg.norm(found.columns["v 1 y"] - slope) < 1e-3 * np.linalg.norm(slope)


def blurred(τ2):
    """A panel seen through a tracker that smooths: model with the effect at that strength, recording, true places."""
    model, recording, x, _ = swung(25)
    effect, θ = SMOOTHING, np.array([τ2])
    seen, edge = (effect.observe(model.subject, field, θ) for field in (x, recording.motion.boundary))
    recording = replace(recording, observed=seen, motion=Motion(recording.motion.collider, edge))
    return model.joined([effect], {effect.name: θ}), recording, x


def test_cloth_that_a_slow_tracker_saw_starts_where_it_was():
    model, recording, x = blurred(2e-3)
    found, as_seen = (states(m, m.driven(recording.motion), recording.observed, 1e-4) for m in (model, replace(model, effects=())))
    miss, before = (np.sqrt(np.mean((s.x - x)[2:-2] ** 2)) for s in (found, as_seen))
    assert miss < 0.3 * before and before > 5e-4


def test_the_derivative_by_a_tracker_that_smooths_starts_where_what_was_seen_stays(panel):
    model, recording, x, v = panel
    model, name, e = model.joined([SMOOTHING], {}), SMOOTHING.name, 1e-6
    D = model.observation_columns(x)[name]

    def seen(τ2):
        own = replace(model, strengths={name: np.array([τ2])})
        start = States(x - τ2 * D, v - τ2 * derivative(D, FPS, 1), "converged")
        return predict(own, recording, Window(0, 8, 4), start).x

    column = predict(model, recording, Window(0, 8, 4), States(x, v, "converged"), columns=True).columns[name]
    slope = (4 * seen(e) - seen(2 * e) - 3 * seen(0.0))[1:] / (2 * e)  # none below zero
    assert np.linalg.norm(column - slope) < 1e-3 * np.linalg.norm(slope)


def test_what_the_start_explains_is_taken_out_of_residual_and_columns(panel):
    model, recording, x, v = panel
    φ = smooth_modes(model.subject.cloth, 6)
    off = States(x + 1e-3 * φ[0][:, None], v, "converged")
    job = Job(model, replace(recording, observed=x), Window(0, 8, 4), off, φ)
    raw, clean, right = follow(job), follow(replace(job, prior=Prior(1e-3, 0.01))), follow(replace(job, states=States(x, v, "converged")))
    size = [np.sqrt(np.nanmean(e.residual**2)) for e in (raw, clean, right)]
    assert size[0] > 2 * size[2] and size[1] < 1.5 * size[2], size  # as if it had started right
    assert set(clean.prediction.columns) == set(PARAMETERS)


def test_where_tangents_hold_a_corrected_start_leaves_what_they_say(panel):
    model, recording, x, v = panel
    φ = smooth_modes(model.subject.cloth, 6)
    off = States(x + 3e-4 * φ[0][:, None], v, "converged")
    job = Job(model, replace(recording, observed=x), Window(0, 8, 4), off, φ, prior=OF_NOISE)
    raw, linear, again = (np.linalg.norm(e.residual) for e in (follow(replace(job, prior=None)), follow(job), follow_corrected(job)))
    assert linear < 0.6 * raw and again < 1.2 * linear, (raw, linear, again)


def test_derivatives_about_another_start_tell_of_the_same_states(panel):
    """What is told differs by what derivatives leave out: a quarter as much at half the distance."""
    model, recording, x, v = panel
    φ = smooth_modes(model.subject.cloth, 6)
    job = Job(model, replace(recording, observed=x), Window(0, 8, 4), States(x, v, "converged"), φ)
    raw, left = follow(job), []
    for ε in (2e-3, 1e-3):
        again = follow(replace(job, start={"x 0 x": ε, "v 1 z": 20 * ε}))
        moved = np.linalg.norm(ε * raw.normals.G[:, raw.normals.index(["x 0 x"])])
        assert again.start and np.linalg.norm(again.normals.g - raw.normals.g) < 0.2 * moved
        left.append(np.linalg.norm(again.residual - raw.residual))
    assert 3 < left[0] / left[1] < 5, left


def test_the_nearer_start_is_as_near_as_derivatives_say(panel):
    model, recording, x, v = panel
    φ = smooth_modes(model.subject.cloth, 6)
    off = States(x + 3e-4 * φ[0][:, None], v, "converged")
    job = Job(model, replace(recording, observed=x), Window(0, 8, 4), off, φ)
    found, linear = follow(job), follow(replace(job, prior=OF_NOISE))
    start, nearer = nearer_start(job, found)
    assert start and np.linalg.norm(x[9:13] - nearer[1:]) < 1.2 * np.linalg.norm(linear.residual) < 0.7 * np.linalg.norm(found.residual)
    assert nearer_start(job, replace(found, simulated=x[8:13])) == ({}, pytest.approx(x[8:13]))  # nothing is nearer than what was seen


def test_a_start_asked_for_anew_forgets_the_one_that_other_states_asked_for(panel):
    """A correction of 20 mm that belonged to other states would be taken off along derivatives 20 mm away."""
    model, recording, x, v = panel
    φ = smooth_modes(model.subject.cloth, 6)
    off = States(x + 1e-3 * φ[0][:, None], v, "converged")
    job = Job(model, replace(recording, observed=x), Window(0, 8, 4), off, φ, prior=Prior(1e-3, 0.01))
    asked = nearer_start(job, follow(job))[0]
    others = replace(job, start={"x 0 x": 0.02, "v 1 z": 0.4})
    plain, kept, anew = (np.linalg.norm(f(j).residual) for f, j in ((follow, job), (follow, others), (follow_nearer, others)))
    assert follow_nearer(others).start == pytest.approx(asked)
    assert anew < 1.2 * plain and kept > 2 * plain, (plain, kept, anew)


SLIP = LIBRARY["boundary_slip"]


def test_a_window_is_a_piece_of_the_run_where_the_band_has_slipped_before(panel):
    """A creep since the first frame was taken for one since the window's: the band jumped back by 13 mm where a late window of a skirt began."""
    model, recording, *_ = panel
    slipping = model.joined([SLIP], {SLIP.name: np.array([0.02, 0.0])})
    n = model.settings.substeps
    fine = replace(slipping, settings=Settings(substeps=1), subject=replace(model.subject, fps=FPS * n))
    drive = slipping.drive(recording.motion).each(lambda motion: cloth_windows.smooth(motion, n))
    frames = list(fine.run_along(drive, recording.observed[0], np.zeros_like(recording.observed[0])))[::n]
    x, v = np.stack([f.x for f in frames]), np.stack([f.v for f in frames])
    found = predict(slipping, recording, Window(0, 15, 5), States(x, v, "converged"))
    assert np.abs(found.x - x[15:21]).max() < 1e-3  # [m] a first step knows no step before it
    assert np.abs(found.x[:, :7] - x[15:21, :7]).max() < 1e-12
    assert np.abs(x[15, :7] - recording.motion.boundary[15]).max() == pytest.approx(0.02 * 15 / FPS)


@pytest.mark.parametrize("name", [name for name, e in LIBRARY.items() if "motion" in e.acts_through and e.kind != "rerun"])
def test_what_drives_a_window_is_a_piece_of_what_drives_the_run(panel, monkeypatch, name):
    """A late body comes from before the window, and a tracker that smooths mixes in what was there."""
    model, recording, x, v = panel
    wall, faces = sheet(3, 3, length=0.3, width=0.3)
    paths = wall + 0.3 * np.sin(np.arange(25) / 4)[:, None, None] * (0, 0, 1)
    beside = replace(recording, collider=Collider(faces), motion=replace(recording.motion, collider=paths))
    effect, n, frames = LIBRARY[name], model.settings.substeps, slice(11, 17)
    with_it = beside.scene(model).joined([effect], {name: np.array([s.typical for s in effect.strengths])})
    given = []
    monkeypatch.setattr(Model, "run_along", lambda self, drive, *_, **options: given.append(drive) or iter([]))
    with pytest.raises(IndexError):  # for there is no frame
        predict(with_it, beside, Window(0, 11, 5), States(x, v, "converged"), columns=True)
    ((drive,), whole) = given, with_it.drive(beside.motion, columns=True)
    for own, of in ((drive.motion, whole.motion), *((drive.modes[c], whole.modes[c]) for c in effect.columns)):
        assert np.allclose(own.collider[::n], of.collider[frames], atol=1e-12)
        assert np.allclose(own.boundary[::n], of.boundary[frames], atol=1e-12)


def test_a_start_inside_the_body_explains_nothing(panel):
    """Tangents of cloth that hangs 4 mm before a wall take it 10 mm back; the wall does not."""
    model, recording, x, v = panel
    wall, faces = sheet(12, 12, length=1.0, width=1.0)
    wall = wall[:, [1, 0, 2]] * (1, -1, 1) + (-0.004, 0.3, -0.3)
    frames = slice(0, 6)
    motion = Motion(np.repeat(wall[None], 6, 0), recording.motion.boundary[frames])
    φ = smooth_modes(model.subject.cloth, 6)
    behind = x[frames] - 0.01 * np.abs(φ[0])[:, None] * (1, 0, 0)
    before = replace(recording.cut(frames), collider=Collider(faces), motion=motion, observed=behind)
    job = Job(model, before, Window(0, 0, 4), States(x, v, "converged"), φ, prior=Prior(0.1, 0.01))
    linear, again = (np.sqrt(np.mean(np.sum(follows(job).residual ** 2, -1))) for follows in (follow, follow_corrected))
    assert linear < 1e-3 and again > 3e-3, (linear, again)


@pytest.mark.parametrize("fabric", [Fabric(450.0, 12.0, 300.0), Fabric(450.0, 3.0, 300.0)])
def test_slopes_about_nearer_starts_are_nearer_to_those_of_the_loss(fabric, monkeypatch):
    """About the start as tracked, with 3 mm of noise, the second fabric's slope in ln κ_b has the wrong sign."""
    noise, h = 3e-3, 0.02
    model, recording, *_ = swung(25, noise=noise)
    wrong, told, met = with_fabric(model, fabric), [], []
    found, φ = states(wrong, recording.motion, recording.observed, noise), smooth_modes(model.subject.cloth, 20)
    todo = [Job(wrong, recording, w, found, φ) for w in windows([recording], FPS, 0.33)]
    for nearer in (lambda followed: followed[1], about_nearer_start):
        monkeypatch.setattr(base_refit, "about_nearer_start", nearer)
        jobs, now = base_refit.about_nearer_starts(todo, list(map(follow, todo)))
        prior = estimated_prior(now, noise)
        told.append(-2 * base_refit.summed(base_refit.weighed(now, prior), PARAMETERS)[1])
        ways = [with_fabric(wrong, moved(fabric, step)[0]) for step in h * np.array([(-1, 0), (1, 0), (0, -1), (0, 1)])]
        losses = [-base_refit.nearer_by(now, [follow(replace(job, model=way)) for job in jobs], prior) for way in ways]
        met.append(np.array([losses[1] - losses[0], losses[3] - losses[2]]) / (2 * h))
    off = [np.linalg.norm(a - b) for a, b in zip(told, met, strict=True)]
    assert off[1] < 0.6 * off[0], (told, met)


def test_the_refit_finds_the_ratios_of_a_twin():
    model, recording, *_ = swung(25, noise=1e-3)
    wrong = with_fabric(model, Fabric(320.0, 1.0, 40.0))
    found = states(wrong, recording.motion, recording.observed, 1e-3)
    φ = smooth_modes(model.subject.cloth, 10)
    todo = [Job(wrong, recording, w, found, φ) for w in windows([recording], FPS)]
    fit = refit(todo, noise=1e-3, iterations=6)
    fabric = fit.model.subject.fabric
    assert fabric.membrane / fabric.density == pytest.approx(FABRIC.membrane / FABRIC.density, rel=0.3)
    assert fabric.bending / fabric.density == pytest.approx(FABRIC.bending / FABRIC.density, rel=0.3)
    misfits = [row["misfit"] for row in fit.history]
    assert misfits[-1] < misfits[0]


@pytest.mark.parametrize(("settled", "ending"), [(10.0, "converged"), (0.3, STUCK), (0.0, STUCK)])
def test_a_refit_that_no_step_betters_does_not_call_that_converged(monkeypatch, settled, ending):
    """No step lowers the misfit, and no first one is longer than 0.31: it is short enough as it is, or when it was shortened, or never."""
    model, recording, *_ = swung(12, noise=1e-3)
    wrong = with_fabric(model, Fabric(320.0, 1.0, 40.0))
    found = states(wrong, recording.motion, recording.observed, 1e-3)
    todo = [Job(wrong, recording, w, found, smooth_modes(model.subject.cloth, 4)) for w in windows([recording], FPS)]
    monkeypatch.setattr(base_refit, "gain", lambda now, tried, loss: 0.0)
    for name, value in {"SETTLED": settled, "LARGEST_STEP": 0.31, "DAMPING": (1e-3, 1e3)}.items():
        monkeypatch.setattr(base_refit, name, value)
    stopped = refit(todo, noise=1e-3, iterations=6)
    assert stopped.ending == ending and stopped.model.subject.fabric == wrong.subject.fabric


def test_steps_that_creep_are_lengthened_by_the_curvature_that_was_not_there():
    A, true, step = np.diag([40.0, 10.0]), np.diag([10.0, 10.0]), np.array([0.2, 0.0])
    g = np.array([8.0, 0.0])  # the step is Gauss–Newton's own: a quarter of the way to the minimum
    assert stretch_of(A, g, g - true @ step, step) == pytest.approx(4.0)
    assert stretch_of(A, g, g - A @ step, step) == 1.0  # as promised
    assert stretch_of(A, g, 1.1 * g, step) == 4.0  # steeper still: as far as may be


def test_a_window_meets_the_collider_of_its_own_recording(panel):
    """The model's may be that of another recording, with more vertices than this one's motion has."""
    model, recording, y, v = panel
    elsewhere = replace(model, subject=replace(model.subject, collider=Collider(np.array([[0, 1, 999]]))))
    known = States(y, v, "converged")
    plain, other = (predict(m, recording, Window(0, 2, 3), known) for m in (model, elsewhere))
    assert other.complete
    np.testing.assert_array_equal(plain.x, other.x)


def test_what_a_tracker_makes_of_some_frames_is_what_it_makes_of_all_while_the_others_stand_still(panel):
    model, _, x, _ = panel
    model = replace(model, effects=(SMOOTHING,), strengths={SMOOTHING.name: np.array([2e-3])})
    dx = np.random.default_rng(0).standard_normal((3, *x.shape[1:]))
    whole = np.zeros_like(x)
    whole[8:11] = dx
    own = model.observed_tangents(x, {"d": dx}, slice(8, 11), columns=False)["d"]
    np.testing.assert_allclose(own, model.observed_tangents(x, {"d": whole}, columns=False)["d"][8:11], rtol=1e-9)
    assert np.abs(own - dx).max() > 0.1


def _columns(rng, modes):
    """A parameter's column and those of start modes [60, 1 + modes], and a residual [60]."""
    F = rng.normal(size=(60, 1 + modes))
    F[:, 0] += 0.3 * F[:, 1]
    return F, rng.normal(size=60), ("κ", *(f"x {k}" for k in range(modes)))


def _marginalised(F, y, names, variance):
    found = marginalised(Normals(names, F.T @ F, F.T @ y, float(y @ y), len(y)), names[1:], variance)
    return np.array([found.G[0, 0], found.g[0], found.c])


def test_a_start_mode_about_to_buckle_is_integrated_out_without_drowning_the_others():
    F, y, names = _columns(np.random.default_rng(3), 3)
    Q = F[:, 2] / np.linalg.norm(F[:, 2])  # what grows beyond measure explains all that lies along it
    κ, a, b, r = (f - Q * (Q @ f) for f in (F[:, 0], F[:, 1], F[:, 3], y))
    C = np.eye(60) + 0.1 * np.outer(a, a) + 0.5 * np.outer(b, b)
    F[:, 2] *= 1e11
    found = _marginalised(F, y, names, np.array([0.1, 1.0, 0.5]))
    np.testing.assert_allclose(found, [κ @ np.linalg.solve(C, f) for f in (κ, r)] + [r @ np.linalg.solve(C, r)], rtol=1e-6)


def test_start_modes_that_all_end_in_one_buckle_leave_what_it_does_not_explain():
    rng = np.random.default_rng(4)
    F, y, names = _columns(rng, 30)
    buckle = rng.normal(size=60)
    F[:, 1:] += 1e11 * np.outer(buckle, rng.normal(size=30))
    found = _marginalised(F, y, names, np.ones(30))
    Q = buckle / np.linalg.norm(buckle)
    left = [f - Q * (Q @ f) for f in (F[:, 0], y)]
    assert 0 < found[0] <= (1 + 1e-6) * left[0] @ left[0] and 0 < found[2] <= (1 + 1e-6) * left[1] @ left[1]
