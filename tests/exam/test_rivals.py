"""Every rival of the diagnosis is what it says it is: an answer in the public form, and the cause where its own method must find it."""

import json
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, cached_property, partial
from pathlib import Path

import numpy as np
import pytest

from flows import blind_prediction, exam_rival
from tasks.effects.library import library
from tasks.exam.rivals import finite_differences, residual_force, sparse_regression
from tasks.exam.rivals.answer import answer, answer_set, probabilities
from tasks.exam.rivals.library import rivals
from tasks.exam.rivals.linear_fit import column_names, fit, typical
from tasks.exam.rivals.rival import NONE, OUTSIDE, Case, Reply, Rival
from tasks.geometry.faults import BadInput
from tests.cloth.test_windows import swung
from tests.flows.test_gap import write

RIVALS = rivals()
LIBRARY = library()
EFFECTS = tuple(LIBRARY[n] for n in ("air_normal_drag", "fabric_hem_mass", "gravity_tilt"))
DRAG = EFFECTS[0]
KEYS = ["version", "verdict", "ranking", "answer_set_90", "gap", "where", "parameters", "record_next", "seconds"]

every = pytest.mark.parametrize("rival", RIVALS.values(), ids=RIVALS)
naming = pytest.mark.parametrize("name", ["finite_differences", "largest_fit_gain", "sparse_regression"])


@cache
def case() -> Case:
    """A panel that swings in drag, on the mesh and in the steps of the diagnosis: only the drag is missing."""
    model, still, x, v = swung(19)
    dragged = replace(model, effects=(DRAG,), strengths={DRAG.name: np.array([4.0])})
    x = np.stack([f.x for f in dragged.run(still.motion, x[0], v[0])])
    noise = 1e-4 * np.random.default_rng(0).standard_normal(x.shape)
    return Case(model, (replace(still, observed=x + noise, noise=np.full(x.shape[:2], 1e-4)),), EFFECTS)


@cache
def reply(name: str) -> Reply:
    """What a rival says of it."""
    return RIVALS[name].reply(case())


def test_the_folder_is_the_list():
    declared = {p.stem for p in Path(exam_rival.__file__).parents[1].glob("tasks/exam/rivals/*.py") if "\nRIVAL = " in p.read_text()}
    assert set(RIVALS) == declared and len(declared) == 6


@every
def test_it_says_what_it_is(rival):
    assert rival.does and "\n" not in rival.does and rival.source
    assert "What it is" in __import__(rival.reply.__module__, fromlist=["_"]).__doc__


@every
def test_its_answer_has_the_public_form(rival):
    found = answer(rival, reply(rival.name), seconds=1.0)
    assert list(found) == KEYS and found["version"] == 1
    json.dumps(found, allow_nan=False)
    names = {n for row in found["ranking"] for n in row["class"]}
    assert {"none", "outside_library"} <= names <= {"none", "outside_library", *LIBRARY}
    shares = [row["probability"] for row in found["ranking"]]
    assert sum(shares) == pytest.approx(1) and shares == sorted(shares, reverse=True)
    assert found["verdict"]["kind"] in ("effect", "none", "outside_library")
    assert set(found["verdict"]["effects"]) == {n for group in found["verdict"]["class"] for n in group}


@every
def test_the_model_that_it_predicts_with_is_its_verdict(rival):
    verdict = next(iter(probabilities(reply(rival.name))))
    acting = tuple(e.name for e in reply(rival.name).after.effects)
    assert set(acting) == set(verdict) - {"none", "outside_library"} or acting == ("residual_force",)


@naming
def test_who_names_finds_drag_on_the_same_mesh(name):
    found = reply(name)
    assert "air_normal_drag" in next(iter(probabilities(found)))
    assert found.after.strengths["air_normal_drag"][0] == pytest.approx(4, rel=0.5)


def test_base_refit_never_names_and_predicts_the_base():
    found = reply("base_refit")
    assert probabilities(found) == {NONE: 1.0, OUTSIDE: 0.0}
    assert found.before is found.after


def test_the_residual_force_closes_the_gap_where_it_was_learnt_and_has_no_name():
    found = reply("residual_force")
    assert probabilities(found)[OUTSIDE] == 1
    before, after = found.residual_mm
    assert after < 0.5 * before


def test_the_residual_force_is_minus_its_energys_slope_and_moves_cloth_by_the_parabola():
    rng = np.random.default_rng(1)
    force, x = rng.standard_normal((2, 5, 3))
    term = residual_force.DeadForce(force)
    numeric = np.zeros_like(x)
    for i in np.ndindex(*x.shape):
        d = np.zeros_like(x)
        d[i] = 1e-4
        numeric[i] = (term.energy(x + d, None) - term.energy(x - d, None)) / 2e-4
    np.testing.assert_allclose(term.gradient(x, None), numeric, rtol=1e-7, atol=1e-9)
    assert residual_force.parabola(np.array([[0, -9.81, 0]]), 30, 30.0)[-1, 0, 1] == pytest.approx(-9.81 / 2)


def test_a_field_of_gravity_is_twice_the_gravity():
    model, recording, x, v = swung(4)
    field = residual_force.ResidualForce(np.tile([0, -9.81, 0], (49, 1)))
    pushed = replace(model, effects=(field,), strengths={field.name: np.ones(1)})
    heavy = replace(model, settings=replace(model.settings, gravity=(0.0, -2 * 9.81, 0.0)))
    a, b = ([f.x for f in m.run(recording.motion, x[0], v[0])][-1] for m in (pushed, heavy))
    np.testing.assert_allclose(a, b, atol=1e-6)


def test_chance_guesses_the_same_case_the_same_way_and_others_otherwise():
    def verdict(shift: float) -> tuple[str, ...]:
        moved = replace(case().recordings[0], observed=case().recordings[0].observed + shift)
        return next(iter(probabilities(RIVALS["chance"].reply(replace(case(), recordings=(moved,))))))

    assert verdict(0.0) == verdict(0.0)
    assert len({verdict(shift) for shift in np.arange(12.0)}) > 2
    assert set(probabilities(reply("chance")).values()) == {1 / 5}


def test_an_answer_set_holds_nine_tenths():
    assert answer_set({("a", "b"): 0.6, ("b", "c"): 0.31, NONE: 0.09}) == ["a", "b", "c"]


def normal_equations(rng, truth, effects=EFFECTS, n=2000):
    S = rng.standard_normal((n, len(column_names(effects)))) / typical(effects)
    r = S @ truth + rng.standard_normal(n)
    return S, r


def test_a_fit_is_least_squares_within_the_ranges():
    S, r = normal_equations(np.random.default_rng(2), np.array([0.3, 0, 8.0, 0.02, 0, 0.03]))
    found = fit(S.T @ S, S.T @ r, EFFECTS, EFFECTS)
    θ, rss, *_ = np.linalg.lstsq(S, r, rcond=None)
    np.testing.assert_allclose(np.r_[found.base, *found.strengths.values()], θ, rtol=1e-8)
    assert found.gain == pytest.approx(r @ r - rss[0])
    assert found.deviation[DRAG.name][0] == pytest.approx(np.sqrt(np.linalg.inv(S.T @ S)[2, 2]))


def test_a_fit_stays_within_its_range_and_leaves_alone_what_nothing_shows():
    S, r = normal_equations(np.random.default_rng(3), np.array([0, 0, -8.0, 0, 0, 0]))
    S[:, 3] = 0
    found = fit(S.T @ S, S.T @ r, EFFECTS, EFFECTS)
    assert found.strengths[DRAG.name][0] == pytest.approx(0, abs=1e-9)
    assert found.strengths["fabric_hem_mass"][0] == pytest.approx(0, abs=1e-12)


def test_stepwise_selection_takes_what_is_there_and_stops():
    S, r = normal_equations(np.random.default_rng(4), np.array([0.2, 0, 8.0, 0, 0, 0.03]))
    found = finite_differences.Differences(r, S, {})
    path = finite_differences.stepwise(partial(found.fit, EFFECTS), EFFECTS, found.aic)
    assert set(path[-1].names) == {"air_normal_drag", "gravity_tilt"}
    assert found.aic(path[0]) == pytest.approx(len(r) * np.log((found.rss - path[0].gain) / len(r)) + 4)


def test_thresholding_keeps_the_planted_term_and_nothing_where_nothing_is_missing():
    pytest.importorskip("pysindy")
    rng = np.random.default_rng(5)
    terms = rng.standard_normal((12, 9, 3, 6))
    noise = 0.1 * rng.standard_normal((12, 9, 3))

    def sets(u):
        frames = [sparse_regression.Frame(t @ u + ε, t) for t, ε in zip(terms, noise, strict=True)]
        return {sparse_regression.named(found, EFFECTS) for found in sparse_regression.bags(frames, np.arange(9), EFFECTS)}

    assert sets(np.array([0.5, 0, 0.8, 0, 0, 0])) == {("air_normal_drag",)}
    assert sets(np.zeros(6)) == {()}


@pytest.fixture
def files(tmp_path):
    """A recording of the panel, and one of which two frames are known; the second's shape."""
    model, recording = case().model, case().recordings[0]
    blind = recording.observed.copy()
    blind[2:, 7:] = np.nan
    write(tmp_path / "track.npz", model, recording)
    write(tmp_path / "blind.npz", model, recording, vertices=blind)
    return tmp_path, blind.shape


def answered(folder: Path, names: Sequence[str], **options) -> dict:
    """What each rival answered, None where it fell over."""
    return exam_rival.run(names, [folder / "track.npz"], predict=folder / "blind.npz", out=folder, **options)


def test_a_rival_answers_from_files(files):
    folder, shape = files
    told = answered(folder, ["chance"], without=["air_lift"])
    found, pred = json.loads((folder / "chance.json").read_text()), np.load(folder / "chance.npz")
    assert told == {"chance": found}
    assert "air_lift" not in {n for row in found["ranking"] for n in row["class"]}
    assert pred["before"].shape == pred["after"].shape == shape and np.isfinite(pred["after"]).all()


def known(monkeypatch, **replies) -> None:
    """Rivals that reply so, all from the refitted base."""
    made = {name: Rival(name, "guesses", "nobody", reply, refits=True) for name, reply in replies.items()}
    monkeypatch.setattr(exam_rival, "rivals", lambda: made)


def base(case: Case) -> Reply:
    """The refitted base, which names nothing."""
    return Reply({NONE: 0.0}, before=case.refitted, after=case.refitted)


def test_what_rivals_share_is_computed_once_and_counted_for_each(files, monkeypatch):
    folder, _ = files
    refits, simulated = [], []

    def refit(self):
        refits.append(time.sleep(0.2))
        return self.model

    shared = cached_property(refit)
    shared.__set_name__(Case, "refitted")
    monkeypatch.setattr(Case, "refitted", shared)
    monkeypatch.setattr(blind_prediction, "predicted", lambda model, recording: simulated.append(model) or recording.observed)
    monkeypatch.setattr(exam_rival, "Pool", Serial)
    known(monkeypatch, one=base, two=base)
    told = answered(folder, ["one", "two"])
    assert len(refits) == len(simulated) == 1
    assert all(told[name]["seconds"] >= 0.2 for name in ("one", "two"))


class Serial:
    """A pool of nobody else."""

    def __init__(self, **_):
        self.map = map

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass


def test_a_rival_that_falls_over_does_not_take_the_others_with_it(files, monkeypatch, capsys):
    folder, _ = files

    def breaks(case):
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr(Case, "refitted", None)
    known(monkeypatch, broken=breaks, sound=lambda case: Reply({NONE: 0.0}, case.model, case.model))
    told = answered(folder, ["broken", "sound"])
    assert told["broken"] is None and told["sound"]["verdict"]["kind"] == "none"
    assert "by nothing" in capsys.readouterr().err and not (folder / "broken.json").exists()
    assert (folder / "sound.json").exists()


@every
def test_who_says_it_refits_starts_from_the_shared_base_and_nobody_else_does(rival, monkeypatch):
    class Asked(Exception):
        pass

    def refused(*_):
        raise Asked

    monkeypatch.setattr(Case, "refitted", property(refused))
    try:
        rival.reply(replace(case(), effects=EFFECTS))
    except Asked:
        assert rival.refits or rival.name == "finite_differences"
    else:
        assert not rival.refits


def test_rivals_that_nobody_knows_or_that_lack_a_package_are_refused(monkeypatch):
    with pytest.raises(BadInput, match="no rival 'oracle'"):
        exam_rival.chosen(["oracle"])
    monkeypatch.setattr(exam_rival, "find_spec", lambda name: None)
    with pytest.raises(BadInput, match="pysindy"):
        exam_rival.chosen(["sparse_regression"])
    assert [r.name for r in exam_rival.chosen(["chance", "base_refit"])] == ["base_refit", "chance"]
