"""Noise in one frame's places, told by a window's frames."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth.nuisances import Prior
from tasks.cloth.shooting import Evidence, Job, follow
from tasks.cloth.start_errors import start_variances
from tasks.cloth.start_state import states
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.unwrinkled_start import unwrinkled_start, without_wrinkles
from tasks.cloth.windows import Normals, Prediction, Window, predict
from tests.cloth.test_windows import swung

NOISE, KEPT, LENGTH = 1e-3, 6, 10
STARTS = (5, 12, 19)
FREE = np.arange(7, 49)


@pytest.fixture(scope="module")
def noisy():
    """A job for each of three windows, and the true places [T, V, 3]."""
    model, recording, x, _ = swung(31, noise=NOISE)
    found, φ = states(model, recording.motion, recording.observed, NOISE), smooth_modes(model.subject.cloth, KEPT)
    return [Job(model, recording, Window(0, t, LENGTH), found, φ) for t in STARTS], x


def test_what_is_simulated_has_fewer_wrinkles(noisy):
    jobs, x = noisy
    after = np.mean([_wrinkled(job, _started(job), x) for job in jobs])
    assert after < 0.75 * np.mean([_wrinkled(job, job.states, x) for job in jobs])


def test_modes_that_are_marginalised_stay(noisy):
    (job, *_), _ = noisy
    t, w = job.window.start, job.φ * job.model.subject.cloth.vertex_areas
    for after, before in zip(unwrinkled_start(job), (job.states.x[t], job.states.v[t]), strict=True):
        d = after - before
        assert np.abs(d).max() > 1e-5
        assert np.abs(w @ d).max() < 1e-9 * np.abs(w).sum() * np.abs(d).max()


def test_a_state_stays_where_nothing_nearer_is_found(noisy):
    """Where the window was seen exactly as it is simulated, and where it cannot be followed."""
    (job, *_), _ = noisy
    seen = job.recording.observed.copy()
    seen[job.window.frames] = predict(job.model, job.recording, job.window, job.states).x
    exact = replace(job, recording=replace(job.recording, observed=seen))
    stuck = replace(job, model=replace(job.model, settings=replace(job.model.settings, newton_iterations=1, halvings=0)))
    assert not follow(stuck).prediction.complete
    for each in (exact, stuck):
        for after, state in zip(unwrinkled_start(each), (each.states.x, each.states.v), strict=True):
            np.testing.assert_array_equal(after, state[job.window.start])


@pytest.mark.parametrize(("mode", "modes"), [(0, 1), (5, 1)])
def test_a_wrinkle_that_bends_leaves_of_bending_what_noise_does_not_feign(noisy, mode, modes):
    """The column of a mode that is bending's own: G/(1 + G s²) is left, s of the prior where the mode is a smooth one, else of the noise."""
    (job, *_), _ = noisy
    fine = replace(job, φ=smooth_modes(job.model.subject.cloth, 8))
    names, G, prior = (f"x {mode} y", "log_bending"), 3e6, Prior(2e-3, 0.1)
    equations = Normals(names, np.full((2, 2), G), np.zeros(2), 0.0, 100)
    found = Evidence(Prediction(job.window, np.zeros(0), {}, "", 0), equations)
    left = without_wrinkles(fine, found, prior, modes)
    s = 2e-3 if mode < modes else float(np.sqrt(start_variances(fine.recording, fine.model.subject, fine.φ, names[:1])[0]))
    assert left.names == ("log_bending",) and 1e-5 < s < NOISE * 2.1
    assert left.G[0, 0] == pytest.approx(G / (1 + G * s**2))


def _started(job):
    """The states with the start of the job's window replaced."""
    x, v, t = job.states.x.copy(), job.states.v.copy(), job.window.start
    x[t], v[t] = unwrinkled_start(job)
    return replace(job.states, x=x, v=v)


def _wrinkled(job, states, x):
    """How far what is simulated is from the truth x [T, V, 3] in what the marginalised modes do not hold, root mean square [m]."""
    d = predict(job.model, job.recording, job.window, states).x[1:] - x[job.window.frames][1:]
    w = job.φ * job.model.subject.cloth.vertex_areas / job.model.subject.cloth.vertex_areas.sum()
    return float(np.sqrt(np.mean((d - np.einsum("kv,ku,tuc->tvc", job.φ, w, d))[:, FREE] ** 2)))
