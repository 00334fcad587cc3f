"""The doubt that the library holds the cause: small where a gap is at its floor, large where the best hypothesis leaves one above it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tasks.cloth.nuisances import Prior
from tasks.cloth.shooting import Evidence
from tasks.cloth.windows import Prediction, Window
from tasks.gap import library_doubt
from tasks.gap.library_doubt import gap_left, unexplained
from tests.gap.synthetic import EFFECTS, NAMES, normals, windows

FLOOR_MM = 2.0


def followed(residual, columns):
    """Evidence of a window of residual [L, V, 3] m and columns name -> [L, V, 3]."""
    whole = {name: np.zeros_like(residual) for name in NAMES} | columns
    plain = normals(np.zeros((2, len(NAMES))), np.zeros(2))
    return Evidence(Prediction(Window(0, 0, 4), np.zeros((5, 3, 3)), whole, "converged", 1), plain, residual)


@pytest.fixture
def damped():
    """Windows that ask for mass damping of one typical strength, and the field that one unit of it moves."""
    w = windows(np.random.default_rng(0), lambda k: {"fabric_mass_damping": 3.0})
    found = w.fit([next(e for e in EFFECTS if e.name == "fabric_mass_damping")])
    return w, found, np.random.default_rng(1).standard_normal((4, 3, 3))


def doubt(w, found, residual, column, replayed=0.5):
    evidence = [followed(residual, {"fabric_mass_damping": column})]
    screened = SimpleNamespace(windows=w, evidence=evidence, prior=Prior(1e-3, 0.1))
    return unexplained(screened, found, None, FLOOR_MM, replayed)


def test_what_a_hypothesis_explains_is_not_left(damped):
    _, found, field = damped
    θ = found.strengths["fabric_mass_damping"]
    own = followed(1e-2 * field, {"fabric_mass_damping": 1e-2 * field / θ})
    assert gap_left([own], found) < 1e-6
    quarter = gap_left([own], found, {"fabric_mass_damping": 0.25 * θ})  # simulated with that much, it is that much that remains
    assert quarter == pytest.approx(0.25 * 1e3 * np.sqrt(np.mean(np.sum((1e-2 * field) ** 2, -1))), rel=1e-6)


def test_a_gap_that_nothing_explains_is_laid_at_no_door_of_the_library(damped):
    w, found, field = damped
    wide = 1e-2 * field  # 17 mm
    assert doubt(w, found, wide, 0 * field) > 0.9
    assert doubt(w, found, wide, wide / found.strengths["fabric_mass_damping"]) < 0.1
    assert doubt(w, found, 1e-3 * field, 0 * field) < 0.35  # at the floor
    assert doubt(w, found, 1e-3 * field, 0 * field, replayed=16.0) > 0.85


def test_forcing_counts_as_far_as_something_is_seen(damped):
    w, found, field = damped
    pushed = replace(found, forcing=0.6)  # [m/s²], twice as much in squares as proves nothing
    floor, above = 1e-3 * field, 2e-3 * field
    assert doubt(w, found, floor, 0 * field) < doubt(w, pushed, floor, 0 * field) < 0.5
    assert doubt(w, found, above, 0 * field) < doubt(w, pushed, above, 0 * field) and doubt(w, pushed, above, 0 * field) > 0.7


@pytest.mark.parametrize(("forcing", "replayed"), [(0.6, 0.5), (1.0, 0.5), (0.6, 12.0)])
def test_doubt_by_hand(damped, monkeypatch, forcing, replayed):
    """4 mm where the floor is 2; a finer mesh would be taken for 0.5 m/s²."""
    monkeypatch.setattr(library_doubt, "numerics_forcing", lambda normals: 0.5)
    w, found, field = damped
    wide = field * 4e-3 / np.sqrt(np.mean(np.sum(field**2, -1)))
    seen = max(4.0**2 / (2.5 * 2.0**2), replayed / 4)
    odds = max(seen, np.sqrt(forcing**2 / (1.5 * 0.5**2 + 0.4**2) * seen)) ** 2
    assert doubt(w, replace(found, forcing=forcing), wide, 0 * field, replayed) == pytest.approx(odds / (1 + odds))


def test_of_what_was_simulated_its_own_windows_tell(damped):
    """About its strength, not about the base; those of the base where too few could be followed with it."""
    w, found, field = damped
    wide = 1e-2 * field
    screened = SimpleNamespace(windows=w, evidence=[followed(wide, {})], prior=Prior(1e-3, 0.1))
    after = SimpleNamespace(
        windows=SimpleNamespace(origin=dict(found.strengths)), evidence=[followed(0.1 * wide, {"fabric_mass_damping": wide})]
    )
    assert unexplained(screened, found, after, FLOOR_MM, 0.5) < 0.3
    after.windows = None
    assert unexplained(screened, found, after, FLOOR_MM, 0.5) > 0.9
