"""Hypotheses in compressed space, against the dense computation and on windows whose cause is known."""

import numpy as np
import pytest

from tasks.cloth.numerics import corrected
from tasks.cloth.shooting import PARAMETERS
from tasks.cloth.windows import Normals, log_determinant, marginalised
from tasks.effects.library import library
from tasks.gap.hypotheses import Windows, likelihood_ratio, student
from tasks.gap.verdict import judge, withdrawn

LIBRARY = library()
EFFECTS = [LIBRARY[n] for n in ("air_normal_drag", "fabric_mass_damping", "contact_friction", "fabric_hem_mass", "gravity_tilt")]
NAMES = [*PARAMETERS, *(c for e in EFFECTS for c in e.columns)]


def normals(A, r, names):
    return Normals(tuple(names), A.T @ A, A.T @ r, float(r @ r), len(r))


def windows(rng, *, truth, count=10, n=400, noise=1.0, drift=0.0, alike=()):
    """Windows with random signatures of one noise standard deviation per typical strength and coordinate; `truth` column -> strength."""
    scale = {c: abs(s.typical) for e in EFFECTS for c, s in zip(e.columns, e.strengths, strict=True)}
    found = []
    for _ in range(count):
        A = rng.standard_normal((n, len(NAMES)))
        for a, b in alike:
            A[:, NAMES.index(b)] = A[:, NAMES.index(a)]
        A /= [scale.get(name, 1.0) for name in NAMES]
        r = A @ [truth.get(name, 0.0) for name in NAMES] + noise * rng.standard_normal(n) + drift * rng.standard_normal(n)
        found.append(normals(A, r, NAMES))
    return Windows(found, EFFECTS)


def test_marginalising_is_the_dense_covariance():
    rng = np.random.default_rng(0)
    A, S, r = rng.standard_normal((50, 3)), rng.standard_normal((50, 4)), rng.standard_normal(50)
    variance = np.array([0.5, 2.0, 1.0, 0.1])
    C = np.eye(50) + S @ np.diag(variance) @ S.T
    n = normals(np.hstack([A, S]), r, ["a", "b", "c", "x 0 x", "x 0 y", "v 0 x", "v 0 y"])
    states = ["x 0 x", "x 0 y", "v 0 x", "v 0 y"]
    m = marginalised(n, states, variance)
    np.testing.assert_allclose(m.G, A.T @ np.linalg.solve(C, A), rtol=1e-10)
    np.testing.assert_allclose(m.g, A.T @ np.linalg.solve(C, r), rtol=1e-9)
    assert m.c == pytest.approx(r @ np.linalg.solve(C, r))
    assert log_determinant(n, states, variance) == pytest.approx(np.linalg.slogdet(C)[1])


def test_the_numerics_column_is_taken_at_one_and_uncertain_by_one():
    rng = np.random.default_rng(1)
    A, D, r = rng.standard_normal((30, 2)), rng.standard_normal(30), rng.standard_normal(30)
    m = corrected(normals(np.column_stack([A, D]), r, ["a", "b", "numerics"]))
    C = np.eye(30) + np.outer(D, D)
    np.testing.assert_allclose(m.g, A.T @ np.linalg.solve(C, r - D), rtol=1e-9)
    assert m.c == pytest.approx((r - D) @ np.linalg.solve(C, r - D))


def test_strengths_are_recovered_within_their_intervals():
    w = windows(np.random.default_rng(2), truth={"air_normal_drag": 6.0, "log_membrane": 0.2})
    h = w.fit([EFFECTS[0]])
    assert h.strengths["air_normal_drag"] == pytest.approx(6.0, abs=4 * np.sqrt(h.covariance[0, 0]))
    assert h.base[0] == pytest.approx(0.2, abs=0.1)
    assert np.sqrt(h.covariance[0, 0]) < 0.5


def test_gains_are_of_windows_that_the_strengths_were_not_fitted_on():
    w = windows(np.random.default_rng(3), truth={"air_normal_drag": 6.0}, count=5)
    h = w.fit([EFFECTS[0]])
    others = Windows([n for k, n in enumerate(w.normals) if k != 2], EFFECTS)
    others.__dict__["overdispersion"] = np.delete(w.overdispersion, 2)
    θ = others.fit([EFFECTS[0]])
    assert h.each[2, 0] == pytest.approx(θ.strengths["air_normal_drag"])


def test_a_strength_stays_within_its_plausible_range():
    w = windows(np.random.default_rng(4), truth={"air_normal_drag": -6.0})
    assert w.fit([EFFECTS[0]]).strengths["air_normal_drag"] == 0.0


def test_a_steady_gain_weighs_more_than_the_same_gain_in_one_window():
    steady, single = np.full(10, 0.1), np.r_[1.0, np.zeros(9)]
    assert likelihood_ratio(steady) > 3 * likelihood_ratio(single)
    assert likelihood_ratio(-steady) == 0
    assert student(steady) > student(single)


@pytest.mark.parametrize("seed", range(5))
def test_the_planted_effect_is_named(seed):
    w = windows(np.random.default_rng(seed), truth={"contact_friction": 0.3})
    verdict = judge([w.fit([e]) for e in EFFECTS], unexplained=0.0)
    assert verdict.kind == "effect" and verdict.classes == (("contact_friction",),)
    assert sum(c.probability for c in verdict.ranking) == pytest.approx(1)


@pytest.mark.parametrize("seed", range(5))
def test_nothing_planted_is_none(seed):
    w = windows(np.random.default_rng(seed), truth={"log_bending": 0.3}, drift=0.5)
    assert judge([w.fit([e]) for e in EFFECTS], unexplained=0.0).kind == "none"


def test_effects_that_look_alike_form_a_class():
    w = windows(np.random.default_rng(7), truth={"air_normal_drag": 8.0}, alike=[("air_normal_drag", "fabric_mass_damping")])
    verdict = judge([w.fit([e]) for e in EFFECTS], unexplained=0.0)
    assert set(verdict.classes[0]) == {"air_normal_drag", "fabric_mass_damping"}


def test_two_causes_are_named_together():
    w = windows(np.random.default_rng(8), truth={"air_normal_drag": 8.0, "contact_friction": 0.3})
    hypotheses = [w.fit([e]) for e in EFFECTS] + [w.fit([EFFECTS[0], e]) for e in EFFECTS[1:]]
    verdict = judge(hypotheses, unexplained=0.0)
    assert {e.name for e in verdict.named.effects} == {"air_normal_drag", "contact_friction"}


def test_what_nothing_explains_is_outside_the_library():
    rng = np.random.default_rng(9)
    w = windows(rng, truth={}, drift=3.0)
    assert judge([w.fit([e]) for e in EFFECTS], unexplained=1.0).kind == "outside_library"


def test_normal_equations_about_a_strength_say_the_same():
    rng = np.random.default_rng(11)
    w = windows(rng, truth={"air_normal_drag": 6.0, "contact_friction": 0.2}, count=6)
    there = []
    for n in w.normals:
        θ = np.zeros(len(n.names))
        θ[n.names.index("air_normal_drag")] = 5.0
        there.append(Normals(n.names, n.G, n.g - n.G @ θ, float(n.c - 2 * n.g @ θ + θ @ n.G @ θ), n.n))
    about = w.about(there, {"air_normal_drag": 5.0})
    for effects in ([EFFECTS[0]], [EFFECTS[0], EFFECTS[2]]):
        here, again = w.fit(effects), about.fit(effects)
        np.testing.assert_allclose(list(again.strengths.values()), list(here.strengths.values()), rtol=1e-6)
        np.testing.assert_allclose(again.gains, here.gains, atol=1e-6)


def test_a_name_that_does_not_help_on_held_out_motion_is_withdrawn():
    w = windows(np.random.default_rng(12), truth={"contact_friction": 0.3})
    named = judge([w.fit([e]) for e in EFFECTS], unexplained=0.0)
    after = withdrawn(named, "it does not help")
    assert after.kind == "none" and after.named is None and after.ranking[0].names == ("none",)
    assert sum(c.probability for c in after.ranking) == pytest.approx(1)
    assert after.ranking[0].probability > named.ranking[[c.names for c in named.ranking].index(("none",))].probability
