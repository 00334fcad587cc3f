"""What was saved is what comes back, only for the same fabric, and a file cut short is no reason to fail."""

import numpy as np
import pytest

from tasks.cloth.adam_fd import Descent
from tasks.cloth.checkpoints import DEATHS, FrameFile, load_descent, save_descent
from tasks.cloth.perseverance import persevere
from tasks.cloth.scene import replay
from tasks.simulator import Fabric
from tests.cloth.test_gauss_newton import TRUTH, panel


def test_a_descent_comes_back(tmp_path):
    descent = Descent(*np.arange(12.0).reshape(4, 3) / 7, ({"loss": 1.0},))
    save_descent(tmp_path / "d.json", descent)
    again = load_descent(tmp_path / "d.json", Descent.at(np.ones(3)))
    np.testing.assert_array_equal(again.second, descent.second)
    assert again.history == descent.history


def test_frames_come_back_once_the_simulation_is_held_to_be_the_killer(tmp_path):
    path = tmp_path / "f.npz"
    scene = panel(4, frames=4)
    frames = persevere(scene.drive, TRUTH, scene.settings, tangents=("log_bending",)).frames
    memory = FrameFile(path)
    for _ in range(DEATHS - 1):
        memory.keep(TRUTH, frames)
        memory = FrameFile(path)
        assert memory.recall(TRUTH) == ()  # begun anew: it must end as if nobody had killed it
    memory.keep(TRUTH, frames)
    found = FrameFile(path).recall(TRUTH)
    np.testing.assert_array_equal(found[-1].tangents["log_bending"][1], frames[-1].tangents["log_bending"][1])
    np.testing.assert_array_equal(found[2].v, frames[2].v)
    assert memory.recall(TRUTH) == ()


@pytest.fixture
def deadly(tmp_path):
    """The file of a replay in which processes have died as often as is allowed."""
    scene, memory = panel(4, frames=4), FrameFile(tmp_path / "f.npz")
    memory.deaths = DEATHS
    memory.keep(TRUTH, persevere(scene.drive, TRUTH, scene.settings).frames)
    return memory.path


def test_frames_come_back_for_the_same_fabric_only(deadly):
    assert FrameFile(deadly).recall(Fabric()) == ()


def test_a_file_cut_short_gives_none(deadly):
    deadly.write_bytes(deadly.read_bytes()[:999])
    assert FrameFile(deadly).recall(TRUTH) == ()


def test_a_replay_that_ended_leaves_no_frames_and_one_without_columns_gives_none(tmp_path):
    scene, memory = panel(4, frames=4), FrameFile(tmp_path / "f.npz")
    bare = replay(scene, TRUTH, memory=memory)
    assert bare.complete and not (tmp_path / "f.npz").exists()
    memory.keep(TRUTH, persevere(scene.drive, TRUTH, scene.settings).frames[:2])
    whole = replay(scene, TRUTH, tangents=("log_bending",), memory=memory)
    assert whole.complete and whole.reasons == () and len(whole.columns["log_bending"]) == 4
