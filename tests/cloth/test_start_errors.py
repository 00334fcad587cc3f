"""What errors of tracking make of the modes of a start, against errors drawn by the thousand, and what follows for stiff cloth."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth.nuisances import Prior, state_names, state_weights
from tasks.cloth.shooting import Job, follow, nearer_start
from tasks.cloth.start_errors import PER_FRAME, start_variances
from tasks.cloth.start_state import states
from tasks.cloth.state_modes import smooth_modes, state_columns
from tasks.cloth.tracking_noise import INDEPENDENT, Correlation
from tasks.cloth.windows import Window
from tests.cloth.test_windows import FPS, swung

NOISE, LENGTH = 2e-3, 10


@pytest.fixture(scope="module")
def noisy():
    return swung(31, noise=NOISE)


@pytest.mark.parametrize("correlation", [INDEPENDENT, Correlation(share=0.8, length=0.2, memory=0.15)])
def test_variances_are_those_of_errors_drawn(noisy, correlation):
    model, recording, *_ = noisy
    cloth, recording, φ = model.subject.cloth, replace(recording, correlation=correlation), smooth_modes(model.subject.cloth, 10)
    ε = correlation.sample(cloth.x_rest, np.full((20_000, 49), NOISE), 1e-3, np.random.default_rng(0))  # frames that remember nothing
    drawn = np.einsum("kv,tvc->tkc", φ * cloth.vertex_areas / cloth.vertex_areas.sum(), ε).var(0)
    names = list(state_columns(φ))
    told = dict(zip(names, start_variances(recording, model.subject, φ, names), strict=True))
    for k in range(10):
        for c, axis in enumerate("xyz"):
            assert told[f"x {k} {axis}"] == pytest.approx(drawn[k, c], rel=0.06)
            assert told[f"v {k} {axis}"] == pytest.approx(told[f"x {k} {axis}"] * (PER_FRAME * FPS) ** 2)


def test_a_start_is_nearer_the_truth_than_one_that_every_mode_may_err_by_the_noise(noisy):
    """Noise of the whole in every mode asks for stretches of centimetres, which nothing sees a frame later."""
    model, recording, x, v = noisy
    φ, found = smooth_modes(model.subject.cloth, 40), states(model, recording.motion, recording.observed, NOISE)
    off = {"as errors are": [], "as wide as noise": []}
    for t in (5, 12, 19):
        job = Job(model, recording, Window(0, t, LENGTH), found, φ)
        followed = follow(job)
        start, _ = nearer_start(job, followed)
        names = state_names(followed.normals.names)
        wide = state_weights(followed.normals, names, [], Prior(NOISE, PER_FRAME * NOISE * FPS).variances(names))[:, 0]
        for how, z in (("as errors are", start), ("as wide as noise", dict(zip(names, wide, strict=True)))):
            started = replace(job, start=z).started
            off[how].append([np.linalg.norm(started.x[t] - x[t]), np.linalg.norm(started.v[t] - v[t])])
        off.setdefault("as tracked", []).append([np.linalg.norm(found.x[t] - x[t]), np.linalg.norm(found.v[t] - v[t])])
    (right, velocity), (wrong, _), (_, before) = (np.mean(each, 0) for each in off.values())
    assert right < 0.5 * wrong and velocity < before
