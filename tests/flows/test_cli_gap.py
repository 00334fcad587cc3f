"""`gap run` as its user meets it: what the words mean, what comes first, and what is said when the rest fails."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flows import blind_prediction, cli, cli_gap, gap, gap_inputs
from tasks.child_process import ChildFailed, ChildTimedOut
from tasks.effects.library import library
from tasks.gap.diagnosis import diagnose
from tasks.geometry.faults import BadInput
from tests.cloth.test_windows import swung
from tests.flows.test_gap import write


@pytest.mark.parametrize(
    "words",
    ["a b --held-out c d --without e f --json", "--held-out c --held-out d --without e --without f -- a b"],
)
def test_a_flag_takes_every_file_that_follows_it(words):
    """The second file held out had become a recording to learn from, without a word."""
    _, bound, _ = cli_gap.app.parse_args(["run", *words.split()], exit_on_error=False, print_error=False)
    assert bound.args == (Path("a"), Path("b"))
    assert bound.kwargs["held_out"] == (Path("c"), Path("d")) and bound.kwargs["without"] == ("e", "f")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tracks")
    model, recording, *_ = swung(12, noise=1e-3)
    blind = recording.observed.copy()
    blind[2:, 7:] = np.nan
    write(folder / "track.npz", model, recording)
    write(folder / "held.npz", model, recording, colour=1)
    write(folder / "blind.npz", model, recording, vertices=blind, texture=1)
    write(folder / "slow.npz", model, recording, fps=20.0)
    return folder, model, recording


@pytest.fixture(scope="module")
def untestable(files):
    _, model, recording = files
    return diagnose(model, [recording], [library()["air_normal_drag"]], quick=True)


@pytest.fixture
def ended(files, untestable, monkeypatch, tmp_path, capsys):
    """Options after a recording -> exit code, stdout and stderr of a `gap run` in a new folder; nothing is simulated."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(gap, "diagnose", lambda *_, **__: untestable)
    monkeypatch.setattr(blind_prediction.BlindPrediction, "write", lambda *_: ("prediction: ends early",))
    monkeypatch.setenv("COLUMNS", "200")

    def run(*options):
        with pytest.raises(SystemExit) as found:
            cli.main(["gap", "run", str(files[0] / "track.npz"), *(str(files[0] / o) if o.endswith(".npz") else o for o in options)])
        told = capsys.readouterr()
        return found.value.code, told.out, told.err

    return run


def test_files_held_out_are_read_once_the_verdict_is_fixed(files, monkeypatch):
    """What is wrong with one had ended the diagnosis when it was done."""
    folder, *_ = files
    read, given, said = [], [], []
    real = gap_inputs.read_tracked_geometry
    monkeypatch.setattr(gap_inputs, "read_tracked_geometry", lambda path, **k: (read.append(path.name), real(path, **k))[1])

    def work(*_, held_out, **__):
        given.extend((list(read), held_out()))
        raise StopIteration

    monkeypatch.setattr(gap, "diagnose", work)
    for name in ("held.npz", "slow.npz"):
        with pytest.raises(StopIteration):
            gap.run(gap.Request((folder / "track.npz",), held_out=(folder / name,)), warn=said.append)
    before, kept, before_slow, kept_slow = given
    assert before == ["track.npz"] and before_slow.count("slow.npz") == 0
    assert [len(r) for r in kept] == [12] and kept_slow == []
    assert any("held.npz: the key 'colour'" in w for w in said)


def test_a_faulty_file_held_out_leaves_the_answer(ended, untestable, monkeypatch):
    """Without a claim on motion kept out."""
    monkeypatch.setattr(gap, "diagnose", lambda *_, held_out, **__: (held_out(), untestable)[1])
    code, out, err = ended("--held-out", "slow.npz", "--json")
    assert code == 1 and json.loads(out)["verdict"]["kind"] == "not_testable"
    assert "nothing was held out" in err and "slow.npz: fps: 20" in err


def test_a_recording_to_learn_from_cannot_be_held_out(files):
    folder, *_ = files
    with pytest.raises(BadInput, match="is also a recording to learn from"):
        gap.read(gap.Request((folder / "track.npz",), held_out=(folder / "track.npz",)))


@pytest.fixture
def links(files, tmp_path, monkeypatch):
    """Where `also.npz` and `page.json` are the recording, and `sub/../again.npz` leads there too."""
    monkeypatch.chdir(tmp_path)
    for name in ("also.npz", "again.npz", "page.json"):
        Path(name).symlink_to(files[0] / "track.npz")
    Path("held.npz").symlink_to(files[0] / "held.npz")
    Path("sub").mkdir()


TRACK = Path("also.npz")
SAME = {
    "twice": ({"tracks": (TRACK, Path("sub/../again.npz"))}, "sub/../again.npz: is the same recording as also.npz"),
    "twice by one name": ({"tracks": (TRACK, TRACK)}, "also.npz: is the same recording as also.npz"),
    "held out twice": (
        {"held_out": (Path("held.npz"), Path("sub/../held.npz"))},
        "--held-out sub/../held.npz: is the same recording as held",
    ),
    "learnt from and held out": ({"held_out": (Path("again.npz"),)}, "--held-out again.npz: is also a recording to learn from, also.npz"),
    "out": ({"out": Path("again.npz")}, "--out again.npz: would overwrite also.npz"),
    "out held out": ({"held_out": (Path("held.npz"),), "out": Path("sub/../held.npz")}, "--out sub/../held.npz: would overwrite held.npz"),
    "out of predict": ({"predict": Path("held.npz"), "out": Path("held.npz")}, "--out held.npz: would overwrite held.npz"),
    "JSON beside the report": (
        {"report": Path("page.html")},
        "--report page.html: the JSON beside it, page.json, would overwrite also.npz",
    ),
    "out and JSON": (
        {"out": Path("sub/p.json"), "report": Path("sub/p.html")},
        "JSON beside it, sub/p.json, would overwrite --out sub/p.json",
    ),
    "out and report": ({"out": Path("sub/p.html"), "report": Path("sub/p.html")}, "--report sub/p.html: would overwrite --out sub/p.html"),
}


@pytest.mark.parametrize("what", SAME)
def test_one_file_under_two_names_is_refused(links, what):
    """A prediction had overwritten the recording, and a file by another path had been held out though it was learnt from."""
    asked, said = SAME[what]
    with pytest.raises(BadInput) as caught:
        gap.read(gap.Request(**({"tracks": (TRACK,)} | asked)))
    assert said in str(caught.value)


def test_outputs_beside_the_recordings_are_no_fault(links):
    asked = gap.Request((TRACK,), (Path("held.npz"),), predict=TRACK, out=Path("sub/pred.npz"), report=Path("sub/pred.html"))
    assert gap_inputs._faults(asked) == []


def test_what_the_files_leave_in_doubt_is_told(files, tmp_path):
    """Of a blind file too, and how the garment is held where no file says it; not how a fit would be made."""
    folder, model, recording = files
    request = gap.Request((folder / "track.npz",), predict=folder / "blind.npz", out=folder / "p")
    told = gap.read(request).warnings
    assert any("blind.npz: the key 'texture'" in w for w in told)
    write(tmp_path / "free.npz", model, recording, boundary=np.zeros(0, int))
    free = gap.read(gap.Request((tmp_path / "free.npz",)))
    assert [w.split(";")[0] for w in free.warnings if w.startswith("boundary")] == ["boundary: none"]
    assert not [w for w in told if w.startswith("boundary")]  # the file names it
    chosen = ("frames 0 to 11 of 12", "boundary: none", "boundary driven by x", "collider: drawn in by x", "doubtful: the weight")
    assert gap_inputs._chosen(replace(free.garment, chosen=chosen), []) == ["boundary: none", "doubtful: the weight"]


def test_a_folder_of_meshes_can_be_diagnosed_with_the_rate_and_axis_that_are_told(files, tmp_path):
    _, model, recording = files
    z_up = recording.observed @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0.0]])  # (x, y, z) becomes (x, −z, y)
    rows = "".join(f"f {a} {b} {c}\n" for a, b, c in model.subject.cloth.faces + 1)
    for t, x in enumerate(z_up):
        (tmp_path / f"mesh{t}.obj").write_text("".join(f"v {a:.9f} {b:.9f} {c:.9f}\n" for a, b, c in x) + rows)
    with pytest.raises(BadInput, match="fps"):
        gap.read(gap.Request((tmp_path,)))
    found = gap.read(gap.Request((tmp_path,), fps=25.0, up="z")).garment
    assert found.model.subject.fps == 25.0
    np.testing.assert_allclose(found.recordings[0].observed, recording.observed, atol=1e-8)


def test_the_command_passes_rate_and_axis_on(monkeypatch, tmp_path):
    asked = []
    monkeypatch.setattr(gap, "run", lambda request, **_: asked.append(request))
    assert cli_gap.run(tmp_path, fps=25.0, up="z") == 0
    assert (asked[0].fps, asked[0].up) == (25.0, "z")


def test_the_limit_is_that_of_the_longest_file(files, monkeypatch, untestable):
    folder, model, recording = files
    long = replace(recording, observed=np.concatenate([recording.observed] * 6))
    write(folder / "long.npz", model, long)
    limits = []

    def pool(*, limit_s, at_once):
        limits.append(limit_s)
        raise StopIteration

    monkeypatch.setattr(gap, "Pool", pool)
    for request in (
        gap.Request((folder / "track.npz",)),
        gap.Request((folder / "track.npz",), predict=folder / "long.npz", out=folder / "p"),
    ):
        with pytest.raises(StopIteration):
            gap.run(request)
    assert limits == [gap.LIMIT_S, gap.LIMIT_S * 72 / 30]


@pytest.mark.parametrize("error", [ChildTimedOut("computation 1 of 2: still running"), ChildFailed("killed"), PermissionError("pred")])
def test_an_answer_outlives_a_prediction_that_fails_and_the_report_is_written(ended, monkeypatch, tmp_path, error):
    """The verdict of hours had gone with it."""

    def fails(*_):
        raise error

    monkeypatch.setattr(blind_prediction.BlindPrediction, "write", fails)
    code, out, err = ended("--predict", "blind.npz", "--out", "pred", "--report", "page.html", "--json")
    assert code == 1 and json.loads(out)["verdict"]["kind"] == "not_testable"
    assert f"blind prediction pred: could not be made; {type(error).__name__}: {error}" in err
    assert (tmp_path / "page.html").exists() and (tmp_path / "page.json").exists()


def test_and_a_report_that_fails(ended, tmp_path, monkeypatch):
    def full(*_):
        raise OSError("no space left")

    monkeypatch.setattr(gap, "replace_file", full)
    code, out, err = ended("--report", "page.html")
    assert code == 1 and "Not testable" in out and "report page.html: could not be made; OSError: no space left" in err


def test_files_are_written_though_nobody_looks_at_the_answer(files, untestable, monkeypatch, tmp_path):
    def unread(told):
        raise BrokenPipeError

    monkeypatch.setattr(gap, "diagnose", lambda *_, **__: untestable)
    with pytest.raises(BrokenPipeError):
        gap.run(gap.Request((files[0] / "track.npz",), report=tmp_path / "page.html"), show=unread)
    assert (tmp_path / "page.html").exists()


def test_what_is_held_in_a_prediction_is_said_on_stderr(ended):
    code, out, err = ended("--predict", "blind.npz", "--out", "pred", "--json")
    assert code == 0 and "prediction: ends early" in err and json.loads(out)


def test_a_place_that_is_a_folder_is_refused_before_work(ended, tmp_path):
    (tmp_path / "pred").mkdir()
    code, out, err = ended("--predict", "blind.npz", "--out", "pred")
    assert code == 2 and "--out pred: is a folder" in err and not out


def test_a_diagnosis_that_takes_too_long_is_not_told_to_go_on_from_a_checkpoint(ended, monkeypatch):
    """It has none, and no stage whose timeout could be raised."""

    def late(*_, **__):
        raise ChildTimedOut("computation 3 of 9: still running after 1800 s")

    monkeypatch.setattr(gap, "diagnose", late)
    code, out, err = ended("--json")
    assert code == 5 and not out and "computation 3 of 9" in err and "--quick" in err and "checkpoint" not in err


def test_units_in_square_brackets_are_shown(ended):
    _, out, _ = ended()
    assert "before [mm]" in out
