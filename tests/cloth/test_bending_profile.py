"""κ_b by losses: bracketed from afar, with the curvature that is met, and none where bending changes nothing."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth.base_parameters import BOUNDS, PARAMETERS
from tasks.cloth.bending_profile import ASIDE, FURTHEST, bracketed
from tasks.cloth.windows import Normals
from tasks.simulator import Fabric

START = Fabric(320.0, 4.0, 60.0)
CLAIMED = np.array([[5e4, 2e3], [2e3, 4e4]])  # JᵀJ of each window, far above what its loss curves by
N = 5000


def windows(curvature, best, *, lost=lambda fabric: False):
    """Two windows whose losses are parabolas in log κ_b about `best`, each off by a tenth its own way; and the fabrics asked for."""
    asked = []

    def follow(fabrics):
        return [told(fabric) for fabric in fabrics]

    def told(fabric):
        asked.append(fabric.bending)
        found = []
        for off in (-0.1, 0.1):
            δ = np.log(fabric.bending / best) - off
            c = N * np.exp(curvature * δ**2 / N)
            found.append(Normals(PARAMETERS, CLAIMED * c / N, np.zeros(2), c, N))
        return None if lost(fabric) else found

    return follow, asked


@pytest.mark.parametrize("best", [9.0, 61.0, 420.0])
def test_the_minimum_is_bracketed_and_its_curvature_is_the_losses(best):
    follow, asked = windows(200.0, best)
    profile = bracketed(START, follow)
    assert abs(np.log(profile.fabric.bending / best)) <= ASIDE / 2 + 0.01
    normal = profile.normal
    np.testing.assert_allclose(np.log(profile.fabric.bending / best) + normal.step[1], 0, atol=0.02)
    assert normal.A.sum(0)[1, 1] == pytest.approx(400.0, rel=1e-3)  # two windows of −∂² log likelihood = 200, where JᵀJ claims 80,000
    assert len(asked) == len(set(asked))
    np.testing.assert_allclose(normal.A.sum(0)[0, 0], 2 * CLAIMED[0, 0])
    jackknife, losses = 0.1, 400**-0.5  # two windows 0.2 apart
    assert np.sqrt(normal.covariance[1, 1]) == pytest.approx(np.hypot(jackknife, losses), rel=0.05)


def test_beyond_a_bound_nothing_is_asked():
    stiff = replace(START, bending=float(np.exp(BOUNDS["log_bending"][1])))
    follow, asked = windows(200.0, 700.0)
    assert bracketed(stiff, follow).normal.step[1] > 0
    assert max(asked) <= 500.0001 and len(asked) == 3


def test_where_bending_changes_nothing_nothing_is_known_of_it():
    follow, asked = windows(0.0, 60.0)
    profile = bracketed(START, follow)
    assert profile.fabric.bending == pytest.approx(60.0) and len(asked) == 3
    assert profile.normal.covariance[1, 1] > 100 / CLAIMED[1, 1]


def test_a_minimum_too_far_away_ends_the_search():
    follow, asked = windows(200.0, 60.0 * np.exp(-20 * ASIDE))
    bracketed(START, follow)
    assert len(asked) <= FURTHEST + 3


def test_a_stiffness_that_cannot_be_followed_is_never_taken():
    follow, _ = windows(200.0, 420.0, lost=lambda fabric: fabric.bending > 200)
    assert bracketed(START, follow) is None
    follow, _ = windows(200.0, 60.0, lost=lambda fabric: fabric.bending > 200)
    assert bracketed(START, follow).fabric.bending == pytest.approx(60.0)
