"""The other engine against closed forms, and a case that it made. Needs MuJoCo's environment, which `physavatar exam --engine mujoco` makes."""

import json
import subprocess
from functools import partial

import numpy as np
import pytest

from flows import exam_engine
from flows.endings import Refused
from tasks.capture.tracked_geometry import tracked_geometry
from tasks.exam.generator.making import make
from tasks.exam.generator.other_engine import EFFECTS, NAMES, OUTSIDE, Laws, job, make_with
from tasks.exam.generator.strata import ENGINE_STRATA, Question, engine_questions
from tasks.exam.generator.subject import drawn_subject


def needs_mujoco(test):
    installed = pytest.mark.skipif(not exam_engine.ready(), reason="no MuJoCo: `physavatar exam --engine mujoco --cases 1` installs it")
    return pytest.mark.slow(installed(test))


FPS, G, DENSITY = 60.0, 9.81, 0.2


def sheet_job(*, frames=60, size=0.24, count=7, tilt=0.0, hung=True, **laws):
    """A square sheet of 0.2 kg/m² as stiff as a plate, hung by its upper edge along x or free, at angle `tilt` to the vertical."""
    g = np.linspace(0, size, count)
    u, w = (c.ravel() for c in np.meshgrid(g, g, indexing="ij"))
    n = np.arange(count * count).reshape(count, count)
    a, b, c, d = n[:-1, :-1].ravel(), n[1:, :-1].ravel(), n[1:, 1:].ravel(), n[:-1, 1:].ravel()
    faces = np.concatenate([np.stack([a, d, c], 1), np.stack([a, c, b], 1)])
    rest = np.stack([u, -w, 0 * u], 1)
    start = np.stack([u, -w * np.cos(tilt), w * np.sin(tilt)], 1)
    driven = n[:, 0] if hung else np.zeros(0, int)
    mass = np.bincount(faces.ravel(), minlength=len(rest)) * DENSITY * size**2 / (3 * len(faces))
    ticks = 2 * (frames - 1) + 1
    still = {
        "places": np.tile(start[driven], (ticks, 1, 1)),
        "a": np.zeros((0, 3)),
        "b": np.zeros((0, 3)),
        "radius": np.zeros(0),
        "bone": np.zeros(0, int),
        "turns": np.zeros((ticks, 0, 3, 3)),
        "shifts": np.zeros((ticks, 0, 3)),
    }
    none = dict.fromkeys(("damping", "normal_drag", "tangential_drag", "linear_drag", "wind_drag", "gusts", "pressure", "settling"), 0.0)
    cloth = {"rest": rest, "faces": faces, "mass": mass, "stretch": 200.0, "bending": 0.02, "poisson": 0.07, "start": start}
    world = {"driven": driven, "friction": 0.2, "gravity": np.array([0, -G, 0]), "wind": np.zeros(3), "every": 2, "tick": 1 / (2 * FPS)}
    return cloth | still | none | world | laws


def resting(ticks, *, slope=0.0, speed=0.0):
    """A sphere so wide that it is a floor, moving along x at `speed` [m/s], and gravity that makes it slope [rad] down along x."""
    t = np.arange(ticks) / (2 * FPS)
    shifts = np.zeros((ticks, 1, 3))
    shifts[:, 0, 0] = speed * t
    floor = {"a": np.array([[0.12, -20.0, 0.12]]), "b": np.array([[0.12, -20.0, 0.12]]), "radius": np.array([20.0]), "bone": np.array([0])}
    down = G * np.array([np.sin(slope), -np.cos(slope), 0])
    return floor | {"turns": np.tile(np.eye(3), (ticks, 1, 1, 1)), "shifts": shifts, "gravity": down}


@needs_mujoco
def test_a_plate_swings_as_a_pendulum_and_does_not_tire():
    hung = sheet_job(frames=150, tilt=0.1)
    x = exam_engine.simulate(hung)["x"]
    r, m = -hung["rest"][:, 1], hung["mass"]
    ω = np.sqrt(G * (m @ r) / (m @ r**2)) * (1 - 0.1**2 / 16)  # a body that hangs from an axis, swinging by 0.1 rad
    angle = np.arctan2(x[:, -1, 2], -x[:, -1, 1])
    t = np.arange(len(x)) / FPS
    assert angle == pytest.approx(0.1 * np.cos(ω * t), abs=0.004)
    assert angle[-60:].max() == pytest.approx(0.1, rel=0.02)


@needs_mujoco
def test_a_flat_sheet_falls_as_drag_lets_it():
    C = 8 * DENSITY
    x = exam_engine.simulate(sheet_job(frames=40, hung=False, tilt=np.pi / 2, normal_drag=C))["x"]
    t, v = np.arange(40) / FPS, np.sqrt(2 * DENSITY * G / (1.2 * C))  # v: what it falls at in the end
    assert x[:, :, 1].mean(1) - x[0, :, 1].mean() == pytest.approx(-(v**2) / G * np.log(np.cosh(G * t / v)), abs=2e-3)


@needs_mujoco
def test_mass_damping_brakes_exponentially():
    x = exam_engine.simulate(sheet_job(frames=40, hung=False, damping=3.0))["x"]
    t = np.arange(40) / FPS
    assert x[:, 5, 1] - x[0, 5, 1] == pytest.approx(-G / 3 * (t - (1 - np.exp(-3 * t)) / 3), abs=2e-3)


@needs_mujoco
@pytest.mark.parametrize("slope", [0.1, 0.4])
def test_a_sheet_slides_on_a_slope_as_friction_lets_it(slope):
    flat = sheet_job(frames=30, hung=False, tilt=np.pi / 2, bending=1e-4)
    x = exam_engine.simulate(flat | resting(59, slope=slope))["x"]
    t = np.arange(30) / FPS
    a = max(G * (np.sin(slope) - 0.2 * np.cos(slope)), 0.0)
    assert x[:, :, 0].mean(1) - x[0, :, 0].mean() == pytest.approx(0.5 * a * t**2, abs=0.015)
    assert np.ptp(x[5:, :, 1]) < 6e-3  # it lies on the floor, which is round


@needs_mujoco
def test_a_moving_body_takes_the_cloth_along():
    """MuJoCo's bodies that are moved by hand have no speed, and their friction would hold cloth back; so none of ours is one."""
    flat = sheet_job(frames=30, hung=False, tilt=np.pi / 2, bending=1e-4)
    x = exam_engine.simulate(flat | resting(59, speed=0.3))["x"]
    gone = x[:, :, 0].mean(1) - x[0, :, 0].mean()
    late = 0.3 / (0.2 * G)  # s until friction has brought it to speed
    assert gone[-1] == pytest.approx(0.3 * (29 / FPS - late / 2), abs=0.01)


@needs_mujoco
def test_a_cloth_that_is_lost_is_said_to_be():
    with pytest.raises(ArithmeticError, match="lost the cloth"):
        exam_engine.simulate(sheet_job(start=100 * sheet_job()["start"]))


@needs_mujoco
def test_a_case_is_readable_reproducible_and_moves_by_what_was_asked():
    question = Question(0, "single", {"air_normal_drag": 4.0}, (), "", "curtain", ("sway", "turn", "ball"), (5, 0))
    made = make(question, partial(make_with, exam_engine.simulate))
    for arrays in (*made.recordings, made.blind, made.held_out):
        track = tracked_geometry({k: np.asarray(v) for k, v in arrays.items()}, name="case")
        assert 200 < len(track.rest_vertices) < 500 and len(track.vertices) == 40
    assert 1.5 < made.truth["multiple"] < 8
    json.dumps(made.truth)


@needs_mujoco
def test_two_engines_agree_on_a_cloth_without_causes():
    question = Question(1, "null", {}, (), "plain", "curtain", ("sway", "turn", "ball"), (6, 1))
    seen = []
    for once in (None, partial(make_with, exam_engine.simulate)):
        made = make(question, once)
        seen.append(np.where(made.held_out["observed"][..., None], made.held_out["vertices"], np.nan))
    assert np.sqrt(np.nanmean(np.sum((seen[0] - seen[1]) ** 2, -1))) < 12e-3


def test_the_engines_cases_are_two_thirds_effects_a_quarter_nulls_and_all_its_names():
    cases = engine_questions(24, 0, NAMES, OUTSIDE)
    assert {s: sum(q.stratum == s for q in cases) for s in ENGINE_STRATA} == ENGINE_STRATA
    assert len({n for q in cases if q.stratum == "single" for n in q.causes}) == 16
    assert {n for q in cases if q.stratum == "outside" for n in q.causes} == set(OUTSIDE)
    assert engine_questions(24, 0, NAMES, OUTSIDE) == cases != engine_questions(24, 1, NAMES, OUTSIDE)


def test_every_effect_changes_what_the_engine_is_given():
    question = Question(0, "null", {}, (), "plain", "skirt", ("sway", "turn", "walk"), (2, 0))
    subject = drawn_subject(question, np.random.default_rng(0))
    sheet = subject.garment.coarse
    plain = job(subject, sheet, Laws(), 0)
    for name, apply in EFFECTS.items():
        changed = job(subject, sheet, apply(Laws(), 0.05), 0)
        assert changed.keys() == plain.keys()
        assert name == "observation_smoothing" or any(np.any(changed[k] != plain[k]) for k in plain), name
    assert job(subject, sheet, Laws(late=0.02), 0)["shifts"][0] == pytest.approx(subject.scenes[0].pose(0.02)[1])
    heavier = job(subject, sheet, Laws(hem=0.05), 0)["mass"].sum() - plain["mass"].sum()
    assert 0.5 < heavier / (0.05 * subject.density) < 3.0  # m: how long the hem of a skirt is


def test_without_a_network_the_refusal_names_the_commands(tmp_path, monkeypatch):
    monkeypatch.setenv("PHYSAVATAR_CACHE", str(tmp_path))
    monkeypatch.setattr(exam_engine.venv, "create", lambda place, **_: place.mkdir(parents=True))
    failed = subprocess.CompletedProcess([], 1, "", "ERROR: no route to host")
    monkeypatch.setattr(exam_engine.subprocess, "run", lambda *_, **__: failed)
    with pytest.raises(Refused, match=r"no route to host\n.*-m pip install .*mujoco-core==4.0.0"):
        exam_engine.prepare()
    assert not exam_engine.ready()
