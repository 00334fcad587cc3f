"""Hypotheses in compressed space, against the dense computation and on windows whose cause is known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import t as student

from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.numerics import corrected
from tasks.cloth.windows import Normals, marginalised
from tasks.effects.library import library
from tasks.gap.confusability import confusability
from tasks.gap.diagnosis import ratios
from tasks.gap.hypotheses import FORM, LEFT, Windows
from tasks.gap.strength_priors import RIDGE
from tasks.gap.verdict import PAIR, TEMPER, abstained, first_alone, judge, nothing_needed
from tasks.simulator.fabric import Fabric

LIBRARY = library()
EFFECTS = [LIBRARY[n] for n in ("air_normal_drag", "fabric_mass_damping", "contact_friction", "fabric_hem_mass", "gravity_tilt")]
FRICTION = LIBRARY["contact_friction"]
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
    assert m.logdet == pytest.approx(np.linalg.slogdet(C)[1])


def test_numerics_are_uncertain_by_one_and_what_is_finer_is_taken_at_one():
    rng = np.random.default_rng(1)
    A, D, r = rng.standard_normal((30, 2)), rng.standard_normal((30, 3)), rng.standard_normal(30)
    m = corrected(normals(np.column_stack([A, D]), r, ["a", "b", "numerics_time_step", "numerics_contact", "numerics_mesh"]))
    C, r = np.eye(30) + D @ D.T, r - D[:, 0] - D[:, 2]
    assert m.names == ("a", "b")
    np.testing.assert_allclose(m.g, A.T @ np.linalg.solve(C, r), rtol=1e-9)
    assert m.c == pytest.approx(r @ np.linalg.solve(C, r))


def test_intervals_know_what_the_mesh_feigns_and_that_laws_have_several_forms():
    w = windows(np.random.default_rng(2), truth={"air_normal_drag": 6.0})
    doubted = Windows(w.given, EFFECTS, feigned={"air_normal_drag": 1.5})
    own, more = (v.fit([EFFECTS[0]]) for v in (w, doubted))
    θ = own.strengths["air_normal_drag"]
    assert more.covariance[0, 0] - own.covariance[0, 0] == pytest.approx(1.5**2)
    assert own.covariance[0, 0] >= (FORM * θ) ** 2


def test_strengths_are_recovered_within_their_intervals():
    w = windows(np.random.default_rng(2), truth={"air_normal_drag": 6.0, "log_membrane": 0.2})
    h = w.fit([EFFECTS[0]])
    assert h.strengths["air_normal_drag"] == pytest.approx(6.0, abs=4 * np.sqrt(h.covariance[0, 0]))
    assert h.base[0] == pytest.approx(0.2, abs=0.1)
    assert np.sqrt(h.covariance[0, 0] - (FORM * h.strengths["air_normal_drag"]) ** 2) < 0.5


def test_misfits_are_of_windows_that_the_strengths_were_not_fitted_on():
    w = windows(np.random.default_rng(3), truth={"air_normal_drag": 6.0}, count=5)
    h = w.fit([EFFECTS[0]])
    others = Windows([n for k, n in enumerate(w.normals) if k != 2], EFFECTS)
    others.__dict__["scale"] = np.delete(w.scale, 2)
    other, n = others.fit([EFFECTS[0]]), w.normals[2]
    step = np.array([*other.base, other.strengths["air_normal_drag"]])
    i = n.index([*PARAMETERS, "air_normal_drag"])
    assert h.misfits[2] == pytest.approx(n.c - 2 * n.g[i] @ step + step @ n.G[np.ix_(i, i)] @ step - w.noise[2])


def test_a_strength_stays_within_its_plausible_range():
    w = windows(np.random.default_rng(4), truth={"air_normal_drag": -6.0})
    assert w.fit([EFFECTS[0]]).strengths["air_normal_drag"] == 0.0


def test_a_strength_that_every_window_asks_for_weighs_more_than_one_that_a_single_window_asks_for():
    """Both close the same share of the misfit."""
    rng = np.random.default_rng(5)
    A = rng.standard_normal((10, 400, len(NAMES)))
    k = NAMES.index("contact_friction")
    noise = rng.standard_normal((10, 400))
    asked = {"steady": np.full(10, 0.3), "once": np.r_[0.3 * np.sqrt(10), np.zeros(9)]}
    weight = {}
    for name, strength in asked.items():
        found = [normals(a, a[:, k] * θ + ε, NAMES) for a, θ, ε in zip(A, strength, noise, strict=True)]
        w = Windows(found, EFFECTS)
        w.__dict__["scale"] = np.ones(10)
        weight[name] = w.fit([LIBRARY["contact_friction"]]).weights[0]
    assert weight["steady"].likelihood > 3 * weight["once"].likelihood
    assert weight["steady"].own_dispersion < 3 < weight["once"].own_dispersion


def test_dispersion_is_one_for_independent_coordinates():
    φ = [windows(np.random.default_rng(seed), truth={}, count=40).fit([EFFECTS[0]]).weights[0].own_dispersion for seed in range(5)]
    assert 0.7 < np.mean(φ) < 1.4


def test_what_no_window_touches_is_as_uncertain_as_it_was():
    """Friction where nothing is touched: its strength was told as zero, to the last digit."""
    rng, k = np.random.default_rng(7), NAMES.index("contact_friction")
    found = windows(rng, truth={})
    for n in found.given:
        n.G[k], n.G[:, k], n.g[k] = 0.0, 0.0, 0.0
    fitted = found.fit([LIBRARY["contact_friction"]])
    spread = RIDGE * LIBRARY["contact_friction"].typical[0]
    assert fitted.θ(LIBRARY["contact_friction"]) == pytest.approx(0.0, abs=1e-9)
    assert np.sqrt(fitted.covariance[0, 0]) == pytest.approx(spread, rel=1e-6)


def test_what_the_mesh_may_feign_weighs_little():
    w = windows(np.random.default_rng(6), truth={"contact_friction": 0.3})
    doubtful = Windows(w.normals, EFFECTS, feigned={"contact_friction": 0.3})
    plain, doubted = (x.fit([LIBRARY["contact_friction"]]).evidence for x in (w, doubtful))
    assert plain > 5 > 1 > doubted


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
    verdict = judge([w.fit([e]) for e in EFFECTS], [w.fit([EFFECTS[0], e]) for e in EFFECTS[1:]], unexplained=0.0)
    assert {e.name for e in verdict.named.effects} == {"air_normal_drag", "contact_friction"}


def test_what_nothing_explains_is_outside_the_library():
    rng = np.random.default_rng(9)
    w = windows(rng, truth={}, drift=3.0)
    assert judge([w.fit([e]) for e in EFFECTS], unexplained=1.0).kind == "outside_library"


@pytest.mark.parametrize("origin", [{"air_normal_drag": 5.0}, {"air_normal_drag": 5.0, "contact_friction": 0.25}])
def test_normal_equations_about_strengths_say_the_same(origin):
    """Of hypotheses without an effect that was simulated, too: held as it was simulated, it had left a second cause nothing to explain."""
    rng = np.random.default_rng(11)
    w = windows(rng, truth={"air_normal_drag": 6.0, "contact_friction": 0.2}, count=6)
    there = []
    for n in w.normals:
        θ = np.array([origin.get(name, 0.0) for name in n.names])
        there.append(Normals(n.names, n.G, n.g - n.G @ θ, float(n.c - 2 * n.g @ θ + θ @ n.G @ θ), n.n))
    about = w.about(there, [e for e in EFFECTS if e.name in origin], origin)
    for effects in ([EFFECTS[0]], [EFFECTS[0], EFFECTS[2]]):
        here, again = w.fit(effects), about.fit(effects)
        np.testing.assert_allclose(list(again.strengths.values()), list(here.strengths.values()), rtol=1e-6)
        for mine, theirs in zip(again.weights, here.weights, strict=True):
            assert mine.evidence == pytest.approx(theirs.evidence, abs=1e-3)


def test_windows_that_no_strength_explains_have_next_to_no_say():
    """Folds that fell otherwise: remainders in `LEFT` numbers, as smooth as the causes are and four times the noise. By their misfit alone
    they would still drown six windows that are explained. A window that asks for another strength is explained, and keeps its say.
    """
    rng, n = np.random.default_rng(5), 5000
    explained, kinked = ([_seen(rng, n, FRICTION, 0.15, folds) for _ in range(6)] for folds in (0.0, 4.0))
    alone, both = (Windows(found, EFFECTS) for found in (explained, [*explained, *kinked]))
    assert both.overdispersion[6:] == pytest.approx(15, rel=0.4) and both.scale[6:].min() > 500
    found, wanted = both.fit([FRICTION]), alone.fit([FRICTION])
    assert found.strengths["contact_friction"] == pytest.approx(wanted.strengths["contact_friction"], rel=0.1)
    assert found.evidence == pytest.approx(wanted.evidence, rel=0.1)
    assert found.freedom == pytest.approx(wanted.freedom, abs=0.1)  # nor do they tell how surely the scatter is known
    by_misfit = Windows(both.given, EFFECTS)
    by_misfit.__dict__["scale"] = both.overdispersion
    assert by_misfit.fit([FRICTION]).evidence < 0.6 * found.evidence
    other = Windows([*explained, _seen(rng, n, FRICTION, 0.5, 0.0)], EFFECTS)
    assert other.scale[6] < 5 and other.fit([FRICTION]).weights[0].own_dispersion > 20


def _seen(rng, n, effect, strength, folds):
    """Normal equations of a window whose causes, and folds, are `LEFT` numbers spread over its coordinates."""
    smooth = rng.standard_normal((n, LEFT)) / np.sqrt(LEFT)
    A = smooth @ rng.standard_normal((LEFT, len(NAMES)))
    r = strength * A[:, NAMES.index(effect.name)] + rng.standard_normal(n) + folds * smooth @ rng.standard_normal(LEFT)
    return normals(A, r, NAMES)


def test_what_another_simulation_leaves_of_a_window_that_nobody_explains_hardly_counts():
    """The simulation with an effect leaves more of one window than derivatives foretold, or less."""
    drag = EFFECTS[0]
    explained = windows(np.random.default_rng(11), truth={drag.name: 6.0})
    kinked = Windows([replace(explained.given[0], c=3 * explained.given[0].c), *explained.given[1:]], EFFECTS)
    for w, least, most in ((explained, 0.8, 1.2), (kinked, 0.0, 0.1)):
        foretold, more = w.fit([drag]).weights[0], 0.5 * w.given[0].n
        for sign in (1, -1):
            there = [replace(n, c=n.c + sign * more * (k == 0)) for k, n in enumerate(w.given)]
            lost = foretold.decrease - w.about(there, [drag], {}).fit([drag]).weights[0].decrease
            assert least < sign * lost / more < most
        assert w.about(w.given, [drag], {}).fit([drag]).weights[0].decrease == pytest.approx(foretold.decrease)


def test_what_motion_kept_out_vetoes_weighs_a_hundredth_of_its_prior_and_is_not_named():
    w = windows(np.random.default_rng(12), truth={"contact_friction": 0.3})
    singles = [w.fit([e]) for e in EFFECTS]
    assert judge(singles, unexplained=0.0).classes == (("contact_friction",),)
    after = judge(singles, unexplained=0.0, vetoed=frozenset({"contact_friction"}))
    assert own(after, "contact_friction") / own(after, "none") == pytest.approx(0.01 / len(singles), rel=0.02)
    assert after.named is None and after.ranking[0].names == ("none",)
    assert sum(c.probability for c in after.ranking) == pytest.approx(1)


def test_what_was_vetoed_is_no_second_cause_either():
    w = windows(np.random.default_rng(7), truth={"air_normal_drag": 8.0, "contact_friction": 0.3})
    singles = [w.fit([e]) for e in EFFECTS]
    pairs = [w.fit([EFFECTS[0], e]) for e in EFFECTS[1:]]
    assert len(judge(singles, pairs, unexplained=0.0).classes) == 2
    after = judge(singles, pairs, unexplained=0.0, vetoed=frozenset({"contact_friction"}))
    assert "contact_friction" not in {n for c in after.classes for n in c}


def test_of_a_second_cause_that_was_simulated_replays_say_what_they_say_beyond_the_first():
    w = windows(np.random.default_rng(7), truth={"air_normal_drag": 8.0})
    singles = [replace(w.fit([e]), support=4.0 if e is EFFECTS[0] else None) for e in EFFECTS]
    pairs = [replace(w.fit([EFFECTS[0], e]), support=4.0) for e in EFFECTS[1:]]
    slow = EFFECTS[-1].name
    odds = {}
    for more in (0.0, 20.0):
        seen = [replace(p, support=4.0 + more) if p.effects[1].name == slow else p for p in pairs]
        found = judge(singles, seen, unexplained=0.0)
        pair = next(c for c in found.ranking if c.fitted is not None and len(c.fitted.effects) == 2)
        odds[more] = pair.probability / own(found, "none")
        assert (slow in {e.name for e in found.named.effects}) == bool(more)
    alone = np.exp(TEMPER * pairs[-1].weights[1].evidence) * PAIR / len(singles) * np.exp(TEMPER * singles[0].evidence + 4.0) / len(singles)
    assert odds[20.0] == pytest.approx(alone * np.exp(20.0), rel=1e-6)


def test_who_abstains_says_what_else_is_likelier():
    w = windows(np.random.default_rng(12), truth={"contact_friction": 0.3})
    named = judge([w.fit([e]) for e in EFFECTS], unexplained=0.0)
    after = abstained(named)
    assert after.kind == "none" and after.named is None
    assert after.probability == own(named, "none") and after.ranking == named.ranking and after.ranking[0].names == ("contact_friction",)


def test_where_nothing_is_needed_none_is_said_though_outside_be_likelier():
    named = judge([windows(np.random.default_rng(12), truth={"contact_friction": 0.3}).fit([e]) for e in EFFECTS], unexplained=0.9)
    assert abstained(named).kind == "outside_library"
    after = nothing_needed(named)
    assert after.kind == "none" and after.probability == own(named, "none") and after.ranking == named.ranking


def own(verdict, name):
    return next(c.probability for c in verdict.ranking if name in c.names)


def test_a_second_cause_that_does_not_help_leaves_the_first_what_both_weighed():
    w = windows(np.random.default_rng(7), truth={"air_normal_drag": 8.0, "contact_friction": 0.15}, count=5, n=60)
    singles = [w.fit([e]) for e in EFFECTS]
    first = max(singles, key=lambda h: h.evidence)
    both = judge(singles, [w.fit([*first.effects, e]) for e in EFFECTS if e not in first.effects], unexplained=0.0)
    assert len(both.classes) == 2
    alone = next(c for c in both.ranking if c.fitted is not None and c.fitted.effects == first.effects)
    assert alone.probability > 0.1  # counts
    after = first_alone(both, first)
    assert after.named is first and after.classes == (alone.names,) and len(after.ranking) == len(both.ranking) - 1
    assert after.probability == pytest.approx(both.probability + alone.probability)
    assert sum(c.probability for c in after.ranking) == pytest.approx(1)


def test_twins_form_a_class_however_plausible_their_strengths():
    """Thickness and offset of a body move cloth alike; one is typically four times the other."""
    w = windows(np.random.default_rng(13), truth={"air_normal_drag": 0.1 * LIBRARY["air_normal_drag"].typical[0]}, n=4000)
    for k, n in enumerate(w.normals):
        G, g = n.G.copy(), n.g.copy()
        a, b = NAMES.index("air_normal_drag"), NAMES.index("fabric_mass_damping")
        G[b], g[b] = 0.05 * G[a], 0.05 * g[a]
        G[:, b] = 0.05 * G[:, a]
        G[b, b] = 0.05**2 * G[a, a]
        w.normals[k] = Normals(n.names, G, g, n.c, n.n)
    singles = [w.fit([e]) for e in EFFECTS]
    apart = judge(singles, unexplained=0.0)
    together = judge(singles, unexplained=0.0, cosines=confusability(w, EFFECTS))
    assert len(apart.classes[0]) == 1
    assert set(together.classes[0]) == {"air_normal_drag", "fabric_mass_damping"}


def test_nothing_is_excluded_with_absurd_certainty():
    """An effect whose strength is known to be zero within a thousandth of the typical one: improbable, not impossible."""
    w = windows(np.random.default_rng(8), truth={}, n=40_000)
    h = w.fit([LIBRARY["contact_friction"]])
    assert h.evidence < -4
    certain = replace(h, weights=(replace(h.weights[0], prior=-400.0),))
    verdict = judge([certain, *(w.fit([e]) for e in EFFECTS if e.name != h.name)], unexplained=0.0)
    assert verdict.kind == "none"
    (own,) = [c for c in verdict.ranking if h.name in c.names]
    assert 1e-4 < own.probability < 1e-1


def test_replays_of_its_own_count_for_or_against_what_was_simulated():
    """Two effects of equal evidence: what comes no nearer over whole recordings falls behind, what does leads; twins' own factor counts
    instead of `missing`.
    """
    w = windows(np.random.default_rng(7), truth={"air_normal_drag": 8.0}, alike=[("air_normal_drag", "fabric_mass_damping")])
    singles = {h.name: h for h in (w.fit([e]) for e in EFFECTS)}
    names = ("air_normal_drag", "fabric_mass_damping")
    for first, second in (names, names[::-1]):
        told = singles | {first: replace(singles[first], support=4.0), second: replace(singles[second], support=-1.0)}
        verdict = judge(list(told.values()), unexplained=0.0, missing=2.0)
        assert verdict.named.name == first and second not in verdict.classes[0]


def test_a_cause_without_evidence_that_leaves_everything_unexplained_is_less_likely_than_one_outside():
    w = windows(np.random.default_rng(4), truth={})
    singles = [w.fit([e]) for e in EFFECTS]
    singles = [replace(h, weights=(replace(h.weights[0], likelihood=0.0, prior=0.0),)) for h in singles]
    verdict = judge(singles, unexplained=1.0, missing=2.5)
    assert verdict.kind == "outside_library"
    assert verdict.probability > 0.8


def test_ratios_are_those_that_the_windows_ask_for_with_numerics_taken_out():
    """They had been those of the simulated base, with an interval about what windows ask for."""
    fabric = Fabric(density=300.0, membrane=1.2, bending=0.9)
    screened = SimpleNamespace(
        base=SimpleNamespace(model=SimpleNamespace(subject=SimpleNamespace(fabric=fabric))),
        windows=SimpleNamespace(base=windows(np.random.default_rng(11), truth={"log_membrane": 0.2, "log_bending": -0.1}).base),
    )
    found, few = ratios(screened), screened.windows.base
    assert found["kappa_s_over_rho"]["value"] == pytest.approx(4e-3 * np.exp(0.2), rel=0.1)
    assert found["kappa_b_over_rho"]["value"] == pytest.approx(3e-3 * np.exp(-0.1), rel=0.1)
    for name, s in zip(("kappa_s_over_rho", "kappa_b_over_rho"), np.sqrt(np.diag(few.base_covariance)), strict=True):
        ends = found[name]
        assert np.log(ends["high"] / ends["low"]) == pytest.approx(2 * student.ppf(0.95, few.freedom) * s)
