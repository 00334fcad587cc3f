"""A replay that is interrupted, stalls or crawls goes on from its last frame, and ends where an undisturbed one does."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth import perseverance
from tasks.cloth.perseverance import Patience, persevere
from tasks.cloth.scene import replay
from tasks.simulator import simulate
from tests.cloth.test_gauss_newton import TRUTH, panel

NAMES = ("log_membrane", "log_bending")


@pytest.fixture(scope="module")
def scene():
    return panel(5, frames=8)


def stalling(at: int, times: int):
    """simulate, but the first `times` walks end before frame `at` (of the recording) as a stalled Newton does."""
    left = {"times": times}
    settings = []

    def walk(*arguments, **named):
        settings.append(named["settings"])
        first = 8 - len(named["collider_motion"])
        fails = left["times"] > 0
        left["times"] -= 1
        for frame in simulate(*arguments, **named):
            if fails and first + frame.index >= at:
                yield replace(frame, ending="Newton stopped after 100 iterations")
                return
            yield frame

    return walk, settings


def test_undisturbed_it_is_one_simulation(scene):
    journey = persevere(scene.drive, TRUTH, scene.settings)
    assert journey.ending == "converged" and journey.reasons == ()
    frames = list(
        simulate(
            scene.cloth,
            TRUTH,
            scene.collider,
            collider_motion=scene.collider_motion,
            boundary_motion=scene.boundary_motion,
            fps=25,
            x0=scene.x0,
            v0=scene.v0,
            settings=scene.settings,
        )
    )
    np.testing.assert_array_equal(journey.frames[-1].x, frames[-1].x)


def test_a_stall_is_gone_on_from_with_twice_the_substeps(scene, monkeypatch):
    walk, settings = stalling(at=4, times=1)
    monkeypatch.setattr(perseverance, "simulate", walk)
    found = replay(scene, TRUTH, tangents=NAMES)
    monkeypatch.undo()
    whole = replay(scene, TRUTH, tangents=NAMES)
    assert found.complete and len(found.x) == 8
    assert [s.substeps for s in settings] == [2, 4]
    assert len(found.reasons) == 1 and "after frame 3" in found.reasons[0] and "Newton stopped" in found.reasons[0]
    np.testing.assert_array_equal(found.x[:4], whole.x[:4])
    finer = replay(replace(scene, settings=replace(scene.settings, substeps=4)), TRUTH)
    assert np.abs(found.x - whole.x).max() < np.abs(finer.x - whole.x).max()  # half the step from frame 4 on, no more


def test_the_tangents_of_a_retried_replay_are_its_derivative(scene, monkeypatch):
    δ, x = 1e-4, {}
    for sign in (-1, 1):
        walk, _ = stalling(at=4, times=1)
        monkeypatch.setattr(perseverance, "simulate", walk)
        x[sign] = replay(scene, replace(TRUTH, bending=TRUTH.bending * np.exp(sign * δ))).x
    walk, _ = stalling(at=4, times=1)
    monkeypatch.setattr(perseverance, "simulate", walk)
    column = replay(scene, TRUTH, tangents=("log_bending",)).columns["log_bending"]
    np.testing.assert_allclose(column[-1], (x[1] - x[-1])[-1] / (2 * δ), atol=3e-3 * np.abs(column[-1]).max())


def test_it_gives_up_after_so_many_attempts_with_every_reason(scene, monkeypatch):
    walk, settings = stalling(at=4, times=9)
    monkeypatch.setattr(perseverance, "simulate", walk)
    found = replay(replace(scene, patience=Patience(attempts=3)), TRUTH)
    assert not found.complete and "Newton stopped" in found.ending
    assert len(found.reasons) == 3 and len(found.x) == 4
    assert [s.substeps for s in settings] == [2, 4, 8]
    assert settings[-1].acceleration_tolerance == 10 * settings[0].acceleration_tolerance


def test_a_start_that_fails_is_loosened(scene, monkeypatch):
    walk, settings = stalling(at=1, times=1)
    monkeypatch.setattr(perseverance, "simulate", walk)
    found = replay(replace(scene, v0=np.ones_like(scene.x0)), TRUTH)
    assert found.complete
    assert settings[1].barrier_distance == settings[0].barrier_distance / 2


def test_a_slow_frame_is_a_reason(scene):
    found = replay(replace(scene, patience=Patience(attempts=2, frame_s=0.0)), TRUTH)
    assert len(found.reasons) == 2 and all("slow" in reason for reason in found.reasons)


def test_frames_kept_from_a_killed_process_are_not_simulated_again(scene, monkeypatch):
    journey = persevere(scene.drive, TRUTH, scene.settings, tangents=NAMES)
    walk, settings = stalling(at=99, times=0)
    monkeypatch.setattr(perseverance, "simulate", walk)
    heard = []
    on = persevere(scene.drive, TRUTH, scene.settings, tangents=NAMES, kept=journey.frames[:5], on_frame=lambda f, _: heard.append(len(f)))
    assert on.ending == "converged" and heard == [6, 7, 8]
    assert [s.substeps for s in settings] == [4]
    assert "killed after frame 4" in on.reasons[0]
    np.testing.assert_array_equal(on.frames[4].x, journey.frames[4].x)
