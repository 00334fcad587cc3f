"""Blind prediction: what it starts from, and how it is computed."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from flows import blind_prediction
from flows.blind_prediction import BlindPrediction
from tasks.cloth.numerics import finer_computed
from tasks.cloth.start_state import States
from tasks.cloth.windows import Prediction, Window, predict
from tasks.effects.library import library
from tasks.gap import blind
from tasks.gap.blind import held, predicted
from tasks.gap.residual import rms_mm
from tasks.simulator.newton import CONVERGED
from tests.cloth.test_windows import swung


def finer_twin(frames, noise):
    """A panel and its recording by the finer computation; both motions [T, V, 3], as that and as the given mesh make it."""
    model, recording, x, v = swung(frames)
    still, whole = States(x, v, CONVERGED), Window(0, 0, frames - 1)
    true, coarse = (predict(m, recording, whole, still).x[:, : x.shape[1]] for m in (finer_computed(model), model))
    ε = noise * np.random.default_rng(0).standard_normal(true.shape)
    return model, replace(recording, observed=true + ε, noise=np.full(true.shape[:2], max(noise, 1e-4))), true, coarse


@pytest.mark.parametrize(("noise", "least"), [(0.0, 1.0), (1e-3, 2.5)])
def test_what_the_finer_computation_does_is_predicted(noise, least):
    """By the recording's own model from two frames; the given mesh would part from it by more than twice that."""
    model, recording, true, coarse = finer_twin(25, noise)
    assert rms_mm(predicted(model, recording)[2:] - true[2:]) < least
    assert rms_mm(coarse[2:] - true[2:]) > 4.0
    assert rms_mm(true[2:] - true[1]) > 20.0  # it moves


@pytest.mark.parametrize(("reached", "finer"), [(3, False), (7, False), (9, True)])
def test_the_given_mesh_predicts_where_the_finer_one_ends_the_earlier(monkeypatch, reached, finer):
    model, recording, *_ = swung(9)

    def predict(m, _, window, __):
        frames = reached if m.effects else 8
        x = np.full((frames, 49, 3), float(len(m.effects)))
        return Prediction(window, x, {}, CONVERGED if frames == len(recording) else "stalled", 0)

    monkeypatch.setattr(blind, "predict", predict)
    assert np.unique(predicted(model, recording)).tolist() == [float(len(finer_computed(model).effects)) if finer else 0.0]


def test_an_edge_between_driven_vertices_is_driven_when_it_is_split():
    model, recording, x, _ = swung(5)
    held_by = np.arange(14)  # two rows, so that the diagonals between them are split
    model = replace(model, subject=replace(model.subject, cloth=replace(model.subject.cloth, boundary=held_by)))
    carried = replace(recording, motion=replace(recording.motion, boundary=x[:, held_by]))
    np.testing.assert_allclose(predicted(model, carried)[:, held_by], x[:, held_by], atol=1e-9)


@pytest.mark.parametrize("name", ["fabric_rest_scale", "observation_scale"])
def test_shrunken_cloth_starts_where_it_was_seen(name):
    """By a base that does not know of 5 % the two frames are drawn out to the lengths of the pattern."""
    model, *_ = swung(13)
    effect = library()[name]
    shrunk = model.joined([effect], {name: np.array([-0.05])})
    _, recording, true, _ = swung(13, fabric=shrunk.dressed().fabric)
    x = predicted(shrunk, recording)
    assert rms_mm(x[:2] - true[:2]) < 1.0
    assert rms_mm(predicted(model, recording)[:2] - true[:2]) > 5.0


@pytest.mark.parametrize(("reached", "used"), [(4, "before"), (9, "after"), (11, "after"), (12, "after")])
def test_a_cause_with_which_cloth_cannot_be_simulated_foretells_nothing(tmp_path, monkeypatch, reached, used):
    """Cloth held at the last state that was reached would be compared with what was seen as if that had been foretold."""
    told = {"before": np.full((9, 3, 3), 1.0), "after": np.full((reached, 3, 3), 2.0)}
    monkeypatch.setattr(blind_prediction, "_predicted", lambda job: told[job[0].name])
    before, after = (SimpleNamespace(name=name) for name in told)
    said = BlindPrediction(SimpleNamespace(map=map), range(12)).write(tmp_path / "pred", before, after)
    assert [p.name for p in tmp_path.iterdir()] == ["pred"]  # at the path that was given, without another ending
    found = np.load(tmp_path / "pred")
    assert "after 9 of 12 frames; its last state is held" in said[0]
    assert [f"after {reached} of 12 frames" in s for s in said[1:]] == ([True] if reached != 9 and reached < 12 else [])
    assert used == "after" or said[1].endswith("`after` is `before` instead")
    assert np.array_equal(found["before"], held(told["before"], 12)) and np.array_equal(found["after"], held(told[used], 12))


def test_a_prediction_to_the_end_says_nothing_and_what_was_there_is_replaced_whole(tmp_path, monkeypatch):
    """Written in place, a prediction that is interrupted would leave half a file under the name of a whole one."""
    out, model = tmp_path / "pred.npz", SimpleNamespace()
    out.write_bytes(b"the old one")
    monkeypatch.setattr(blind_prediction, "_predicted", lambda job: np.ones((12, 3, 3)))
    writer = BlindPrediction(SimpleNamespace(map=map), range(12))
    with monkeypatch.context() as full:
        full.setattr(blind_prediction.np, "savez_compressed", _fails_half_way)
        with pytest.raises(OSError, match="full"):
            writer.write(out, model, model)
    assert out.read_bytes() == b"the old one"
    assert writer.write(out, model, model) == () and np.load(out)["after"].shape == (12, 3, 3)


def _fails_half_way(file, **arrays):
    write = file.write_bytes if isinstance(file, Path) else file.write
    write(b"half")
    raise OSError("full")
