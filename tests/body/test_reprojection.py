import numpy as np
import pytest

from tasks.body.reprojection import PAPER_CAMERAS, ROUNDING, SATURATION, WORKING_SIZE, Sight
from tasks.geometry.cameras import project
from tests.body.actors import SIZE, ring


@pytest.fixture(scope="module")
def scene():
    rng = np.random.default_rng(0)
    cameras = ring(4)
    p = rng.normal(0, 0.4, (6, 3))
    uv = project(cameras, p)[0] + rng.normal(0, 20, (4, 6, 2))
    score = rng.uniform(0.2, 1, (4, 6))
    uv[0, 1], score[2, 3] = np.nan, 0
    return cameras, p, uv, score


def test_energy_is_equation_1_of_all_that_was_seen(scene):
    """Term by term, in plain Python."""
    cameras, p, uv, score = scene
    weight = np.linspace(1, 2, 6)
    total = 0.0
    at = project(cameras, p)[0]
    for c in range(4):
        for q in range(6):
            if np.isfinite(uv[c, q]).all() and score[c, q] > 0:
                e = np.linalg.norm(at[c, q] - uv[c, q]) * WORKING_SIZE / SIZE
                g = e**2 * SATURATION**2 / (SATURATION**2 + e**2)
                total += weight[q] * PAPER_CAMERAS / 4 * score[c, q] * (np.sqrt(ROUNDING**2 + g) - ROUNDING)
    assert Sight.of(cameras, uv, score, weight).energy(p) == pytest.approx(total, rel=1e-12)


def test_gradient_is_the_finite_difference(scene):
    cameras, p, uv, score = scene
    sight = Sight.of(cameras, uv, score, np.ones(6))
    E, g, C = sight.expand(p)
    assert pytest.approx(sight.energy(p)) == E
    for q in range(6):
        for a in range(3):
            step = np.zeros_like(p)
            step[q, a] = 1e-6
            assert (sight.energy(p + step) - sight.energy(p - step)) / 2e-6 == pytest.approx(g[q, a], rel=1e-5, abs=1e-5)
    assert np.linalg.eigvalsh(C).min() > -1e-9


def test_same_error_of_a_finer_image_and_of_more_cameras_weighs_the_same(scene):
    cameras, p, uv, score = scene
    coarse = Sight.of(cameras, uv, score, np.ones(6)).energy(p)
    fine = Sight.of(cameras.scaled(4), uv * 4, score, np.ones(6)).energy(p)
    assert fine == pytest.approx(coarse, rel=1e-9)
    twice = cameras.subset([0, 1, 2, 3, 0, 1, 2, 3])
    assert Sight.of(twice, np.tile(uv, (2, 1, 1)), np.tile(score, (2, 1)), np.ones(6)).energy(p) == pytest.approx(coarse, rel=1e-9)


def test_a_detection_far_away_hardly_pulls(scene):
    cameras, p, _, _ = scene
    truth = project(cameras, p)[0]
    near, far = truth.copy(), truth.copy()
    near[0, 0, 0] += 10
    far[0, 0, 0] += 400
    pulls = [np.linalg.norm(Sight.of(cameras, uv, np.ones((4, 6)), np.ones(6)).expand(p)[1][0]) for uv in (near, far)]
    assert pulls[1] < 0.05 * pulls[0]
