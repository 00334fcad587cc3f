"""The diagnosis on files: its JSON to the letter, the blind prediction, and input that cannot be diagnosed."""

import json

import numpy as np
import pytest

from flows import gap
from flows.cli import main
from tasks.geometry.faults import BadInput
from tests.cloth.test_windows import FPS, swung


def write(path, model, recording, **others):
    subject = model.subject
    arrays = {
        "vertices": recording.observed,
        "faces": subject.cloth.faces,
        "fps": FPS,
        "boundary": subject.cloth.boundary,
        "rest_vertices": subject.cloth.x_rest,
        "noise_m": float(recording.noise[0, 0]),
    }
    np.savez(path, **(arrays | others))
    return path


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tracks")
    model, recording, x, _ = swung(31, noise=1e-3)
    blind = recording.observed.copy()
    blind[2:, 7:] = np.nan
    write(folder / "track.npz", model, recording)
    write(folder / "blind.npz", model, recording, vertices=blind)
    return folder, model, recording, x


@pytest.fixture(scope="module")
def answered(files):
    folder, *_ = files
    request = gap.Request((folder / "track.npz",), predict=folder / "blind.npz", out=folder / "pred.npz", quick=True)
    return gap.run(request)[0], np.load(folder / "pred.npz")


def test_the_answer_has_the_public_form(answered):
    found, _ = answered
    assert list(found) == ["version", "verdict", "ranking", "answer_set_90", "gap", "where", "parameters", "record_next", "seconds"]
    assert set(found["verdict"]) == {"kind", "effects", "class", "probability", "sentence"}
    assert set(found["gap"]) == {"before_mm", "after_mm", "floor_mm", "closed_fraction", "low", "high", "held_out"}
    assert set(found["parameters"]) == {"kappa_s_over_rho", "kappa_b_over_rho"}
    json.dumps(found, allow_nan=False)


def test_the_ranking_weighs_none_and_outside_too(answered):
    ranking = answered[0]["ranking"]
    assert sum(row["probability"] for row in ranking) == pytest.approx(1)
    assert {"none", "outside_library"} <= {n for row in ranking for n in row["class"]}


def test_a_null_recording_blames_nobody(answered):
    assert answered[0]["verdict"]["kind"] == "none", answered[0]["verdict"]["sentence"]


def test_where_covers_every_vertex_and_frame(answered, files):
    where = answered[0]["where"]
    assert len(where["vertex_mm"]) == len(where["vertex_accel"]) == 49
    assert len(where["frame_mm"]) == 31
    assert {row["zone"] for row in where["zones"]} == {"free", "hem"}


def test_the_blind_prediction_follows_the_garment(answered, files):
    _, pred = answered
    x = files[3]
    assert pred["before"].shape == pred["after"].shape == x.shape
    still = np.sqrt(np.mean((x[1] - x) ** 2))
    assert np.sqrt(np.mean((pred["before"] - x) ** 2)) < 0.3 * still


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"faces": "fewer"}, "share one garment"),
        ({"fps": 60.0}, "fps"),
        ({"frames": 5}, "frames"),
        ({"scale": 100.0}, "unit (metres)"),
    ],
)
def test_files_that_do_not_fit_are_refused(files, tmp_path, change, told):
    folder, model, recording, _ = files
    others = {}
    if "faces" in change:
        others["faces"] = np.delete(model.subject.cloth.faces, 30, axis=0)  # its corners have other faces
    if "fps" in change:
        others["fps"] = change["fps"]
    if "frames" in change:
        others["vertices"] = recording.observed[:5]
    if "scale" in change:
        others["vertices"] = recording.observed * change["scale"]
    other = write(tmp_path / "other.npz", model, recording, **others)
    with pytest.raises(BadInput) as refused:
        gap.run(gap.Request((folder / "track.npz", other)))
    assert told in str(refused.value) and "other.npz" in str(refused.value)


@pytest.mark.parametrize(
    "arguments",
    [["nowhere.npz"], ["TRACK", "--predict", "TRACK"], ["TRACK", "--without", "air_normal_dragg"], ["TRACK", "--held-out", "gone.npz"]],
)
def test_usage_faults_end_with_2(files, arguments):
    track = str(files[0] / "track.npz")
    with pytest.raises(SystemExit) as ended:
        main(["gap", "run", *(track if a == "TRACK" else a for a in arguments)])
    assert ended.value.code == 2
