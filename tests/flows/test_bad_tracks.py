"""Whatever is wrong with files of tracked geometry, `gap run` and `cloth fit` end with 2 before any work and tell everything at once: file,
value, remedy.
"""

import numpy as np
import pytest

from flows import cli, gap
from tasks.cloth import stage
from tests.capture.test_hang_checks import panel

FRAMES = 12


def track(**changes) -> dict:
    """A panel of 0.4 m that hangs from its first row and sways."""
    arrays = panel(frames=FRAMES)
    arrays["vertices"] = 0.4 * arrays["vertices"]
    x = arrays["vertices"][0].copy()
    return arrays | {"rest_vertices": x, "uv": x[:, :2], "noise_m": 1e-3} | changes


def without(key: str) -> dict:
    arrays = track()
    del arrays[key]
    return arrays


def with_holes(key: str, at, value=np.nan) -> dict:
    arrays = track(collider_vertices=track()["vertices"] - [0, 0, 0.3], collider_faces=track()["faces"])
    arrays[key] = arrays[key].astype(type(value) if isinstance(value, float) else arrays[key].dtype).copy()
    arrays[key][at] = value
    return arrays


FAULTY = {
    "pattern without area": (lambda: with_holes("uv", slice(0, 4), 0.0), "have no area in the pattern"),
    "pattern flipped": (lambda: with_holes("uv", 0, 0.3), "flipped against the rest"),
    "pattern in texture coordinates": (lambda: track(uv=10 * track()["uv"]), "10 times as long"),
    "wrong up axis": (lambda: track(up="z"), "free cloth hangs 90 degrees away from downwards"),
    "cloth of 1,700 m": (lambda: track(vertices=4250 * track()["vertices"], rest_vertices=4250 * track()["rest_vertices"]), "metres"),
    "cloth of 1.7 mm": (
        lambda: {k: v for k, v in track(vertices=track()["vertices"] / 235).items() if k not in ("rest_vertices", "uv")},
        "metres",
    ),
    "no fps": (lambda: without("fps"), "has no 'fps'"),
    "fps of 30,000": (lambda: track(fps=30000), "Give it in frames per second"),
    "collider absent in some frames": (
        lambda: with_holes("collider_vertices", slice(3, 5)),
        "in 2 of 12 frames, the first is frame 3",
    ),
    "face out of range": (lambda: with_holes("faces", 0, 99), "names 99 but there are 9"),
    "rest shape with NaN": (lambda: with_holes("rest_vertices", 4), "3 values are not finite"),
    "vertices never seen": (lambda: with_holes("vertices", (slice(None), slice(0, 5))), "never seen"),
    "hardly anything seen": (
        lambda: track(observed=np.arange(FRAMES)[:, None] + np.zeros(9) < 2),
        "17% of the positions",
    ),
}


def write(folder, **files) -> dict[str, str]:
    for name, arrays in files.items():
        np.savez(folder / f"{name}.npz", **arrays)
    return {name: str(folder / f"{name}.npz") for name in files}


def ended(*arguments: str) -> int:
    with pytest.raises(SystemExit) as found:
        cli.main(list(arguments))
    return found.value.code


@pytest.fixture(autouse=True)
def no_work(monkeypatch, tmp_path):
    def work(*arguments, **options):
        raise AssertionError("work has started")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(gap, "diagnose", work)
    monkeypatch.setattr(stage, "fit_windows", work)


@pytest.mark.parametrize("command", [["gap", "run"], ["cloth", "fit"]], ids=" ".join)
@pytest.mark.parametrize("what", FAULTY)
def test_a_faulty_file_is_refused_before_work(tmp_path, capsys, command, what):
    make, says = FAULTY[what]
    files = write(tmp_path, faulty=make())
    assert ended(*command, files["faulty"]) == 2
    told = capsys.readouterr().err.replace("\n", " ")
    assert "faulty.npz" in told and says in told


def test_a_sound_file_gets_to_work(tmp_path, capsys):
    files = write(tmp_path, sound=track())
    for command in (["gap", "run"], ["cloth", "fit"]):
        assert ended(*command, files["sound"]) == 1
        assert "work has started" in capsys.readouterr().err


def test_faults_of_all_files_and_of_the_command_are_told_at_once(tmp_path, capsys):
    blind = with_holes("vertices", (slice(2, None), slice(0, 7)))
    files = write(tmp_path, one=without("fps") | {"uv": 0 * track()["uv"]}, two=track(mass_kg=400.0), blind=blind)
    held = ("--held-out", "gone.npz", "--without", "air_normal_dragg")
    assert ended("gap", "run", files["one"], files["two"], *held, "--predict", files["blind"], "--report", "page.pdf") == 2
    told = capsys.readouterr().err
    for words in (
        ("one.npz", "has no 'fps'"),
        ("one.npz: uv", "have no area"),
        ("two.npz: mass_kg", "400"),
        ("blind.npz: boundary", "vertex 6 is not known in frame 2"),
        ("gone.npz", "no such file"),
        ("--without", "Did you mean 'air_normal_drag'"),
        ("--predict and --out", "Give both"),
        ("--report page.pdf", ".html"),
    ):
        assert any(all(word in line for word in words) for line in told.splitlines()), words


def test_files_of_different_garments_are_told_apart_all_at_once(tmp_path, capsys):
    other = track(faces=track()["faces"][:-1], fps=50)
    blind = with_holes("vertices", (slice(0, None), slice(0, 6))) | {"boundary": np.array([7, 8])}
    files = write(tmp_path, one=track(), two=other, blind=blind)
    assert ended("gap", "run", files["one"], files["two"], "--predict", files["blind"], "--out", "pred.npz") == 2
    told = capsys.readouterr().err
    for words in (
        ("two.npz: faces", "7 faces, the first file has 8"),
        ("two.npz: fps", "50, the first file has 25"),
        ("blind.npz: boundary", "differs from the first file's"),
        ("blind.npz: vertices", "33% of the garment are known in frame 0"),
    ):
        assert any(all(word in line for word in words) for line in told.splitlines()), words


def test_a_blind_file_must_know_what_is_driven_even_where_it_does_not_say_what_that_is(tmp_path, capsys):
    blind = with_holes("vertices", (slice(4, None), slice(0, 9)))
    del blind["boundary"]
    files = write(tmp_path, one=track(), blind=blind)
    assert ended("gap", "run", files["one"], "--predict", files["blind"], "--out", "pred.npz") == 2
    assert "driven vertex 6 is not known in frame 4; 8 of 12 frames lack some" in capsys.readouterr().err.replace("\n", " ")
