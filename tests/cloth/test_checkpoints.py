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
            replay(scene, TRUTH, tangents=NAMES, memory=Dies(tmp_path / "f.npz", after))
    memory = FrameFile(tmp_path / "f.npz")
    found = replay(scene, TRUTH, tangents=NAMES, memory=memory)
    np.testing.assert_array_equal(found.x, whole.x)
    np.testing.assert_array_equal(found.columns["log_bending"], whole.columns["log_bending"])
    assert found.reasons == () and found.newton_iterations == whole.newton_iterations and not memory.path.exists()


def test_a_simulation_that_is_held_to_be_the_killer_goes_on_in_smaller_steps(tmp_path):
    scene, path = panel(4, frames=4), tmp_path / "f.npz"
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
    scene, memory = panel(4, frames=4), FrameFile(tmp_path / "f.npz")
    memory.keep(TRUTH, persevere(scene.drive, TRUTH, scene.settings).frames, None)
    assert memory.recall(TRUTH) == ((), None)


@pytest.fixture
def deadly(tmp_path):
    """The file of a replay in which processes have died as often as is allowed."""
    scene, memory = panel(4, frames=4), FrameFile(tmp_path / "f.npz")
    memory.deaths, memory.furthest = DEATHS, 4
    memory.keep(TRUTH, persevere(scene.drive, TRUTH, scene.settings).frames, None)
    return memory.path


def test_frames_come_back_for_the_same_fabric_only(deadly):
    assert FrameFile(deadly).recall(Fabric()) == ((), None)


def test_a_file_cut_short_gives_none(deadly):
    deadly.write_bytes(deadly.read_bytes()[:999])
    assert FrameFile(deadly).recall(TRUTH) == ((), None)


def test_a_replay_that_ended_leaves_no_frames_and_one_without_columns_gives_none(tmp_path):
    scene, memory = panel(4, frames=4), FrameFile(tmp_path / "f.npz")
    bare = replay(scene, TRUTH, memory=memory)
    assert bare.complete and not (tmp_path / "f.npz").exists()
    memory.keep(TRUTH, persevere(scene.drive, TRUTH, scene.settings).frames[:2], None)
    whole = replay(scene, TRUTH, tangents=("log_bending",), memory=memory)
    assert whole.complete and whole.reasons == () and len(whole.columns["log_bending"]) == 4
