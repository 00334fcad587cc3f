"""What was saved is what comes back, only for the same fabric, and a file cut short is no reason to fail."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth import stage
from tasks.cloth.adam_fd import Descent
from tasks.cloth.checkpoints import DEATHS, FrameFile, load_descent, load_progress, save_descent, save_progress
from tasks.cloth.gauss_newton import Progress
from tasks.cloth.perseverance import persevere
from tasks.cloth.scene import replay
from tasks.cloth.stage import FitParameters, Work
from tasks.simulator import Fabric
from tasks.stage import Job
from tests.cloth.test_gauss_newton import TRUTH, observed, panel


def test_a_descent_comes_back(tmp_path):
    descent = Descent(*np.arange(12.0).reshape(4, 3) / 7, ({"loss": 1.0},), reasons=("iteration 1: slow",))
    save_descent(tmp_path / "d.json", descent)
    again = load_descent(tmp_path / "d.json", Descent.at(np.ones(3)))
    np.testing.assert_array_equal(again.second, descent.second)
    assert again.history == descent.history and again.reasons == descent.reasons


def test_progress_comes_back(tmp_path):
    progress = Progress(replace(TRUTH, bending=100 / 7), 0.1 / 3, ({"loss": 1 / 7, "frames": 9, "rms_mm": None},), "", ("slow",))
    save_progress(tmp_path / "p.json", progress)
    assert load_progress(tmp_path / "p.json", Progress(Fabric())) == progress
    assert load_progress(tmp_path / "other.json", progress) is progress


NAMES = ("log_bending",)


class Killed(Exception):
    """The process ends here."""


class Dies(FrameFile):
    """A memory in a process that is killed once so many frames have been kept."""

    def __init__(self, path, after):
        super().__init__(path)
        self.after = after

    def keep(self, fabric, frames, standing):
        super().keep(fabric, frames, standing)
        if len(frames) > self.after:
            raise Killed


def test_a_replay_that_was_killed_ends_as_if_nobody_had_killed_it(tmp_path):
    scene = panel(5, frames=6)
    whole = replay(scene, TRUTH, tangents=NAMES)
    for after in (0, 1, 2, 3):  # more often than DEATHS, but further each time
        with pytest.raises(Killed):
            replay(scene, TRUTH, tangents=NAMES, memory=Dies(tmp_path / "f", after))
    memory = FrameFile(tmp_path / "f")
    found = replay(scene, TRUTH, tangents=NAMES, memory=memory)
    np.testing.assert_array_equal(found.x, whole.x)
    np.testing.assert_array_equal(found.columns["log_bending"], whole.columns["log_bending"])
    assert found.reasons == () and found.newton_iterations == whole.newton_iterations and not memory.path.exists()


def test_a_simulation_that_is_held_to_be_the_killer_goes_on_in_smaller_steps(tmp_path):
    scene, path = panel(4, frames=4), tmp_path / "f"
    with pytest.raises(Killed):
        replay(scene, TRUTH, tangents=NAMES, memory=Dies(path, 2))
    for _ in range(DEATHS - 1):
        frames, standing = FrameFile(path).recall(TRUTH)  # and dies before another frame is kept
        assert len(frames) == 3 and standing is not None
    frames, standing = FrameFile(path).recall(TRUTH)
    assert len(frames) == 3 and standing is None
    found = replay(scene, TRUTH, tangents=NAMES, memory=FrameFile(path))
    assert found.complete and "twice the substeps" in found.reasons[0]


def test_a_replay_that_goes_on_more_carefully_leaves_nothing_to_resume(tmp_path):
    scene, memory = panel(4, frames=4), FrameFile(tmp_path / "f")
    memory.keep(TRUTH, persevere(scene.drive, TRUTH, scene.settings).frames, None)
    assert memory.recall(TRUTH) == ((), None)


@pytest.fixture
def deadly(tmp_path):
    """The file of a replay in which processes have died as often as is allowed."""
    scene, memory = panel(4, frames=4), FrameFile(tmp_path / "f")
    memory.deaths, memory.furthest = DEATHS, 4
    memory.keep(TRUTH, persevere(scene.drive, TRUTH, scene.settings).frames, None)
    return memory


def test_frames_come_back_for_the_same_fabric_only(deadly):
    """And another one's replay, begun and ended in the meantime, takes nothing from them."""
    memory = FrameFile(deadly.stem)
    assert memory.recall(Fabric()) == ((), None)
    memory.forget()
    assert len(FrameFile(deadly.stem).recall(TRUTH)[0]) == 4


def test_a_file_cut_short_gives_none(deadly):
    deadly.path.write_bytes(deadly.path.read_bytes()[:999])
    assert FrameFile(deadly.stem).recall(TRUTH) == ((), None)


def test_a_replay_that_ended_leaves_no_frames_and_one_without_columns_gives_none(tmp_path):
    scene, memory = panel(4, frames=4), FrameFile(tmp_path / "f")
    bare = replay(scene, TRUTH, memory=memory)
    assert bare.complete and not list(tmp_path.iterdir())
    memory.keep(TRUTH, persevere(scene.drive, TRUTH, scene.settings).frames[:2], None)
    whole = replay(scene, TRUTH, tangents=("log_bending",), memory=memory)
    assert whole.complete and whole.reasons == () and len(whole.columns["log_bending"]) == 4


START = replace(TRUTH, bending=100.0)


def whole_replay(tmp_path, monkeypatch, dies):
    """A fit on the whole replay of a panel, in a process whose memory may end it."""
    scene = observed(panel(4, frames=8), 0)
    monkeypatch.setattr(stage, "FrameFile", dies)
    monkeypatch.setattr(stage, "knowledge", lambda *arguments, **named: {})
    job = Job("anna", "walk", None, tmp_path, lambda share, text: None, lambda text: None)
    work = Work("panel", replace(scene, x0=scene.observed[0]), START)
    return stage._by_whole_replay(job, work, FitParameters(method="whole-replay", iterations=2), map)[1]


def test_a_fit_that_dies_in_one_replay_again_and_again_goes_on_in_smaller_steps(tmp_path, monkeypatch):
    """In the fourth frame with the fabric of the first step, unless that is gone on with carefully."""
    deadly = []

    class DiesInTheFirstStep(FrameFile):
        def keep(self, fabric, frames, standing):
            if fabric != START and not deadly:
                deadly.append(fabric)
            if fabric in deadly and len(frames) > 3 and standing is not None:
                raise Killed
            super().keep(fabric, frames, standing)

    for _ in range(DEATHS):
        with pytest.raises(Killed):
            whole_replay(tmp_path, monkeypatch, DiesInTheFirstStep)
    found = whole_replay(tmp_path, monkeypatch, DiesInTheFirstStep)
    assert any("killed after frame 2: gone on from there with twice the substeps" in reason for reason in found.reasons)


def test_a_fit_that_was_killed_once_ends_as_if_nobody_had_killed_it(tmp_path, monkeypatch):
    """In the second step; the fabric that it set out from is not simulated again."""
    met = []

    class DiesOnce(FrameFile):
        def keep(self, fabric, frames, standing):
            super().keep(fabric, frames, standing)
            met.append(fabric)
            if len(set(met)) == 3 and len(frames) > 3 and not killed:
                killed.append(fabric)
                raise Killed

    killed = []
    for name in ("alone", "killed"):
        (tmp_path / name).mkdir()
    alone = whole_replay(tmp_path / "alone", monkeypatch, FrameFile)
    with pytest.raises(Killed):
        whole_replay(tmp_path / "killed", monkeypatch, DiesOnce)
    assert START in met
    met.clear()
    found = whole_replay(tmp_path / "killed", monkeypatch, DiesOnce)
    np.testing.assert_array_equal(found.replay.x, alone.replay.x)
    assert found.history == alone.history and found.reasons == alone.reasons == ()
    assert killed[0] in met and START not in met
