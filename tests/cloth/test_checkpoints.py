"""What was saved is what comes back, only for the same fabric, and a file cut short is no reason to fail."""

import numpy as np

from tasks.cloth.adam_fd import Descent
from tasks.cloth.checkpoints import FrameFile, load_descent, load_fabric, save_descent, save_fabric
from tasks.cloth.perseverance import persevere
from tasks.cloth.scene import replay
from tasks.simulator import Fabric
from tests.cloth.test_gauss_newton import TRUTH, panel


def test_fabric_and_descent_come_back(tmp_path):
    save_fabric(tmp_path / "a.json", TRUTH)
    assert load_fabric(tmp_path / "a.json", Fabric()) == TRUTH
    assert load_fabric(tmp_path / "none.json", Fabric()) == Fabric()
    descent = Descent(*np.arange(12.0).reshape(4, 3) / 7, ({"loss": 1.0},))
    save_descent(tmp_path / "d.json", descent)
    again = load_descent(tmp_path / "d.json", Descent.at(np.ones(3)))
    np.testing.assert_array_equal(again.second, descent.second)
    assert again.history == descent.history


def test_frames_come_back_once_and_for_the_same_fabric_only(tmp_path):
    scene, memory = panel(4, frames=4), FrameFile(tmp_path / "f.npz")
    frames = persevere(scene.drive, TRUTH, scene.settings, tangents=("log_bending",)).frames
    memory.keep(TRUTH, frames)
    found = memory.recall(TRUTH)
    np.testing.assert_array_equal(found[-1].tangents["log_bending"][1], frames[-1].tangents["log_bending"][1])
    np.testing.assert_array_equal(found[2].v, frames[2].v)
    assert memory.recall(TRUTH) == ()
    memory.keep(TRUTH, frames)
    assert memory.recall(type(TRUTH)()) == ()
    memory.keep(TRUTH, frames)
    (tmp_path / "f.npz").write_bytes((tmp_path / "f.npz").read_bytes()[:999])
    assert memory.recall(TRUTH) == ()


def test_a_replay_that_ended_leaves_no_frames_and_one_without_columns_gives_none(tmp_path):
    scene, memory = panel(4, frames=4), FrameFile(tmp_path / "f.npz")
    bare = replay(scene, TRUTH, memory=memory)
    assert bare.complete and not (tmp_path / "f.npz").exists()
    memory.keep(TRUTH, persevere(scene.drive, TRUTH, scene.settings).frames[:2])
    whole = replay(scene, TRUTH, tangents=("log_bending",), memory=memory)
    assert whole.complete and whole.reasons == () and len(whole.columns["log_bending"]) == 4
