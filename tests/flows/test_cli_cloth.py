"""`physavatar cloth fit` on a track that no other stage has seen."""

import json

import numpy as np
import pytest

from flows import cli
from tasks.cloth.scene import replay
from tests.cloth.test_gauss_newton import TRUTH, panel


def run(*arguments) -> int:
    with pytest.raises(SystemExit) as ended:
        cli.main([str(a) for a in arguments])
    return ended.value.code


@pytest.fixture
def track(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene = panel(5, frames=5)
    x = replay(scene, TRUTH).x
    path = tmp_path / "panel.npz"
    np.savez(path, vertices=x, faces=scene.cloth.faces, fps=25.0, boundary=scene.cloth.boundary, rest_vertices=scene.cloth.x_rest)
    return path


@pytest.mark.slow
def test_a_track_is_fitted_stored_and_found_again(track, capsys):
    assert run("cloth", "fit", track, "--at-rest", "--iterations", 4, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["artifact"]["actor"] == "_track" and len(told["artifact"]["sequence"]) == 64
    assert {"kappa_s_over_rho", "kappa_b_over_rho", "density"} <= set(told["parameters"])
    last = told["history"][-1]
    assert last["rms_mm"] < np.sqrt(3)  # 1 mm in each coordinate is assumed where the file names no noise, and here is none
    for key, true in (("kappa_s", TRUTH.membrane), ("kappa_b", TRUTH.bending)):
        assert np.log(last[key] / true) == pytest.approx(0, abs=0.3)
    assert "gauge" in told["knowledge"] and not told["cached"]
    assert run("cloth", "fit", track, "--at-rest", "--iterations", 4, "--json") == 0
    again = json.loads(capsys.readouterr().out)
    assert again["cached"] and again["parameters"] == told["parameters"]


def test_one_replay_of_the_whole_by_flag(track, capsys):
    """It begins with the loss of its start and lowers it; no windows are cut."""
    assert run("cloth", "fit", track, "--at-rest", "--method", "whole-replay", "--iterations", 2, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    losses = [row["loss"] for row in told["history"]]
    assert 2 <= len(losses) <= 3 and losses == sorted(losses, reverse=True) and losses[-1] < losses[0]


@pytest.mark.slow
def test_algorithm_1_by_flag(track, capsys):
    assert run("cloth", "fit", track, "--at-rest", "--method", "adam-fd", "--as-released", "--iterations", 2, "--json") == 0
    rows = json.loads(capsys.readouterr().out)["history"]
    assert [abs(r["density"] - 320) <= 0.2 for r in rows] == [True, True]
    assert rows[0]["steps"] == 4 * 4


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere.npz"], "no such file"),
        (["panel.npz", "--boundary", "skinned"], "ride on a body"),
        (["broken.npz"], "broken.npz"),
        (["panel.npz", "--frames", "0"], "frames: Input should be greater than or equal to 2"),
        (["panel.npz", "--iterations", "0"], "iterations: Input should be greater than or equal to 1"),
        (["panel.npz", "--substeps", "0"], "substeps: Input should be greater than or equal to 1"),
    ],
)
def test_bad_input_ends_with_2(track, capsys, arguments, said):
    (track.parent / "broken.npz").write_bytes(b"PK nothing")
    assert run("cloth", "fit", *arguments) == 2
    captured = capsys.readouterr()
    assert said in captured.err.replace("\n", " ") and captured.out == ""
