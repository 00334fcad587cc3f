"""What a strength is worth that is not known."""

import numpy as np
import pytest

from tasks.effects.library import library
from tasks.gap.strength_priors import log_averaged

LIBRARY = library()


def test_averaging_over_strengths_is_the_integral():
    """Against quadrature over all strengths, one sign and both."""
    drag, tilt = LIBRARY["air_normal_drag"], LIBRARY["gravity_tilt"]
    t, ν = drag.typical[0], 15
    θ, σ = 0.6 * t, 0.2 * t
    u = np.exp(np.linspace(np.log(1e-3), np.log(1e3), 200_001))
    p = np.exp(-0.5 * (np.log(u) / np.log(3)) ** 2) / (u * np.log(3) * np.sqrt(2 * np.pi))
    student = (1 + ((u * t - θ) / σ) ** 2 / ν) ** (-ν / 2)
    assert log_averaged(np.array([θ]), np.array([[σ**2]]), drag, ν) == pytest.approx(np.log(np.trapezoid(p * student, u)), abs=0.02)
    for k in (1.0, 3.0):  # windows ask for less than nothing
        less = (1 + ((u * t + k * σ) / σ) ** 2 / ν) ** (-ν / 2) / (1 + k**2 / ν) ** (-ν / 2)
        found = log_averaged(np.zeros(1), np.array([[σ**2]]), drag, ν, asked=np.array([-k * σ]))
        assert found == pytest.approx(np.log(np.trapezoid(p * less, u)), abs=0.02)
    one = log_averaged(tilt.typical * (0.6, 0), np.diag((0.1 * tilt.typical) ** 2), tilt, ν)
    wide = log_averaged(tilt.typical * (0.6, 0), np.diag((0.2 * tilt.typical) ** 2), tilt, ν)
    assert wide - one == pytest.approx(2 * np.log(2), abs=0.3)  # two directions, each twice as uncertain


def test_a_strength_of_either_sign_of_which_nothing_is_known_is_neither_favoured_nor_disfavoured():
    friction = LIBRARY["contact_friction"]
    assert friction.strengths[0].low < 0
    assert log_averaged(np.zeros(1), np.diag(1e8 * friction.typical**2), friction, 10) == pytest.approx(0.0, abs=0.01)


def test_a_strength_that_the_mesh_feigns_as_well_claims_half_of_what_it_might():
    """Where nothing is known of a strength, half of its prior lies above the typical one."""
    drag = LIBRARY["air_normal_drag"]
    anything, shown = (log_averaged(np.zeros(1), np.diag(1e8 * drag.typical**2), drag, 10, shows=shows) for shows in (0.0, 1.0))
    assert anything == pytest.approx(0.0, abs=0.01)
    assert shown - anything == pytest.approx(np.log(0.5), abs=0.02)
