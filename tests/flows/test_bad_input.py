"""Whatever is wrong with an input, `submit` ends with 2 before any work, names the file and the remedy, and leaves the store as it was."""

import errno
import json
import os
import shutil
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest

from flows import cli
from flows.config import load
from flows.endings import ending_of
from flows.preflight import preflight
from storage_schemas import artifact
from storage_schemas.object_store import open_store
from tasks.cloth.tracked_scene import FEWEST_FRAMES
from tasks.geometry.faults import BadInput
from tests.flows import recordings
from tests.flows.recordings import tiny_recording, tiny_videos
from tests.storage_schemas.examples import key_of, keypoints, provenance


def calibration(folder: Path, change) -> None:
    file = folder / "1x/calibration.csv"
    lines = file.read_text().splitlines()
    file.write_text("\n".join(change(lines)) + "\n")


def cell(lines: list[str], row: int, column: str, value: str) -> list[str]:
    names = [n.strip() for n in lines[0].split(",")]
    cells = lines[row].split(",")
    cells[names.index(column)] = value
    return [*lines[:row], ",".join(cells), *lines[row + 1 :]]


def picture(folder: Path, kind: str = "rgb", camera: str = "Cam002", frame: int = 1) -> Path:
    return folder / f"1x/{kind}s/{camera}/{camera}_{kind}{frame:06d}.{'jpg' if kind == 'rgb' else 'png'}"


def template(folder: Path, old: str, new: str) -> None:
    file = folder / "template/template.obj"
    file.write_text(file.read_text().replace(old, new, 1))


def truncate(file: Path) -> None:
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def scale_positions(lines: list[str], factor: float) -> list[str]:
    for row in range(1, len(lines)):
        for column in ("tx", "ty", "tz"):
            value = lines[row].split(",")[[n.strip() for n in lines[0].split(",")].index(column)]
            lines = cell(lines, row, column, repr(float(value) * factor))
    return lines


def scale_template(folder: Path, factor: float) -> None:
    file = folder / "template/template.obj"
    lines = [
        "v " + " ".join(repr(float(x) * factor) for x in line.split()[1:4]) if line.startswith("v ") else line
        for line in file.read_text().splitlines()
    ]
    file.write_text("\n".join(lines) + "\n")


def blank(file: Path, shape: tuple[int, int]) -> None:
    cv2.imwrite(str(file), np.zeros(shape, np.uint8))


BROKEN = {
    "missing camera": lambda f: calibration(f, lambda lines: lines[:-1]),
    "duplicate camera": lambda f: calibration(f, lambda lines: [*lines, lines[-1]]),
    "camera without images": lambda f: [p.unlink() for p in (f / "1x/rgbs/Cam003").iterdir()],
    "unequal frame counts": lambda f: picture(f).unlink(),
    "truncated jpeg": lambda f: truncate(picture(f)),
    "mask of another size": lambda f: cv2.imwrite(str(picture(f, "mask")), np.full((20, 20), 255, np.uint8)),
    "empty mask": lambda f: blank(picture(f, "mask"), cv2.imread(str(picture(f, "mask")), 0).shape),
    "nan in calibration": lambda f: calibration(f, lambda lines: cell(lines, 2, "fx", "nan")),
    "rotation that is none": lambda f: calibration(f, lambda lines: cell(lines, 2, "rx", "inf")),
    "millimetres": lambda f: calibration(f, lambda lines: scale_positions(lines, 1000.0)),
    "kilometres": lambda f: calibration(f, lambda lines: scale_positions(lines, 0.001)),
    "template with nan": lambda f: template(f, "v -0.5", "v nan"),
    "template face out of range": lambda f: template(f, "f 1", "f 99"),
    "template in mm": lambda f: scale_template(f, 1000.0),
    "person of 1.7 mm": lambda f: scale_template(f, 0.001),
    "template non-manifold": lambda f: (f / "template/template.obj").open("a").write("v 0 -2 0\nf 1 2 9\n"),
    "template zero area": lambda f: (f / "template/template.obj").open("a").write("f 1 2 2\n"),
    "part named as a path": lambda f: template(f, "g body", "g ../../etc"),
    "template winding": lambda f: template(f, "f 1 2 4", "f 2 1 4"),
}


NO_BODY_MODEL = {
    "of another layout": lambda file: np.savez(file, v_template=np.zeros((3, 3))),
    "text": lambda file: file.write_text("not a model"),
    "absent": lambda file: None,
}


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tiny_recording(tmp_path / "data")


@pytest.fixture
def kept(place):
    """What the store held before: bytes of every file, to be the same afterwards."""
    store = open_store("artifacts")
    store.publish(keypoints(), actor="eve", sequence="walk", stage="keypoints", key=key_of(0), provenance=provenance())
    return contents(Path("artifacts"))


def contents(root: Path) -> dict[Path, bytes]:
    return {file: file.read_bytes() for file in sorted(root.rglob("*")) if file.is_file()}


def submit(*more: str, actor: str = "ann", until: str = "capture") -> int:
    with pytest.raises(SystemExit) as ended:
        cli.main(["submit", actor, "--until", until, *more])
    return ended.value.code


@pytest.mark.parametrize("what", BROKEN)
def test_a_broken_recording_is_refused_before_work(place, kept, capsys, what):
    BROKEN[what](place)
    assert submit() == 2
    said = capsys.readouterr().err
    assert "fault" in said
    assert str(Path("data/ann/one")) in said
    assert contents(Path("artifacts")) == kept


def test_a_matrix_that_is_no_rotation_is_refused_before_work(place, kept, capsys):
    folder = tiny_videos(place.parents[1])
    file = folder / "calibration.json"
    rig = json.loads(file.read_text())
    rig["cameras"]["Cam002"]["R"][0] = [2.0, 0.0, 0.0]
    file.write_text(json.dumps(rig))
    assert submit(actor="bob") == 2
    said = capsys.readouterr().err
    assert "R is no rotation" in said
    assert str(file.relative_to(Path.cwd())) in said
    assert contents(Path("artifacts")) == kept


@pytest.mark.parametrize("what", NO_BODY_MODEL)
def test_a_file_that_is_no_body_model_is_refused_before_work(place, kept, capsys, what):
    NO_BODY_MODEL[what](Path("not_smplx.npz"))
    assert submit("--set", "body.model=not_smplx.npz", until="body") == 2
    assert "not_smplx.npz" in capsys.readouterr().err
    assert contents(Path("artifacts")) == kept


def without(*names: str):
    def remove(folder: Path) -> None:
        for name in names:
            shutil.rmtree(folder / name)

    return remove


NOTHING_TO_WORK_ON = {
    "no surface": (without("template", "1x/masks"), "tracking", "neither a template nor a mask"),
    "no template, garments wanted": (without("template"), "cloth", "no template: no garment"),
    "no garment": (without(), "report", "template/template.obj has no part but 'body'"),
    "two frames of a garment": (lambda f: template(f, "f 1 2 4", "g skirt\nf 1 2 4"), "cloth", "2 frames tell nothing of how cloth moves"),
}


@pytest.mark.parametrize("what", NOTHING_TO_WORK_ON)
def test_what_a_later_stage_will_lack_is_told_before_work(place, kept, capsys, what):
    change, until, said = NOTHING_TO_WORK_ON[what]
    change(place)
    assert submit(until=until) == 2
    told = capsys.readouterr().err
    assert said in told
    assert "--until" in told
    assert contents(Path("artifacts")) == kept


def test_one_camera_serves_for_the_capture_alone(place):
    settings = load([f"capture.recording={place}", 'capture.cameras=["Cam001"]'])
    with pytest.raises(BadInput, match=f"{place}/1x: there is 1 camera, .*--until capture"):
        preflight(settings, "keypoints")
    preflight(settings, "capture")


@pytest.fixture
def dressed(monkeypatch, tmp_path):
    """A recording of enough frames and with a garment: all that comes before the appearance can be had."""
    monkeypatch.setattr(recordings, "FRAMES", FEWEST_FRAMES)
    place = tiny_recording(tmp_path / "data", sequence="long")
    template(place, "f 1 2 4", "g skirt\nf 1 2 4")
    return place


NO_APPEARANCE = {
    "no masks": (without("1x/masks"), "", "masks: there are none"),
    "a judge who is no camera": (without(), "appearance.held_out=4", "held_out: camera 4 of a rig of 4"),
    "a reduction that does not divide": (without(), "appearance.reduce=5", "px is not a multiple of 5"),
}


@pytest.mark.parametrize("what", NO_APPEARANCE)
def test_pictures_without_appearance_are_refused_before_work_and_serve_for_the_rest(dressed, what):
    change, setting, said = NO_APPEARANCE[what]
    change(dressed)
    settings = load([f"capture.recording={dressed}", *filter(None, [setting])])
    for until in ("appearance", "report"):
        with pytest.raises(BadInput, match=f"{dressed}.*{said}.*, or stop earlier: --until gap"):
            preflight(settings, until)
    preflight(settings, "gap")


FRAMES, CAMERAS = recordings.FRAMES, recordings.CAMERAS
NO_KEYPOINTS = {
    "text": (lambda file: file.write_text("no keypoints"), "not a readable .npz"),
    "absent": (lambda file: None, "no such file or folder"),
    "a frame too many": (lambda file: np.savez(file, keypoints=pixels(FRAMES + 1, CAMERAS)), "it has 3 frames, the recording 2"),
    "a camera too few": (lambda file: np.savez(file, keypoints=pixels(FRAMES, CAMERAS - 1)), "the recording has 4 cameras"),
    "shares of the picture": (lambda file: np.savez(file, keypoints=pixels(FRAMES, CAMERAS) / 64), "lie within 1 px"),
}


def pixels(frames: int, cameras: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(1, 64, (frames, cameras, 133, 3)) / [1, 1, 64]


@pytest.mark.parametrize("what", NO_KEYPOINTS)
def test_keypoints_found_elsewhere_that_are_none_of_this_recording_are_refused_before_work(place, kept, capsys, what):
    change, said = NO_KEYPOINTS[what]
    change(Path("k.npz"))
    assert submit("--set", "keypoints.file=k.npz", until="keypoints") == 2
    told = capsys.readouterr().err
    assert "k.npz" in told and said in told.replace("\n", " ")
    assert contents(Path("artifacts")) == kept


def test_keypoints_of_a_broken_recording_leave_its_faults_told_once(place, capsys):
    """Whose they should be nobody knows then."""
    BROKEN["truncated jpeg"](place)
    np.savez("k.npz", keypoints=pixels(FRAMES, CAMERAS))
    assert submit("--set", "keypoints.file=k.npz", until="keypoints") == 2
    assert capsys.readouterr().err.count("Cam002_rgb000001") == 1


def test_keypoints_found_elsewhere_pass_where_they_fit(place):
    np.savez("k.npz", keypoints=pixels(FRAMES, CAMERAS))
    preflight(load([f"capture.recording={place}", "keypoints.file=k.npz"]), "keypoints")


def test_pictures_through_a_lens_are_refused_before_work(tmp_path):
    """The keypoints and the tracking can do with them."""
    folder = tiny_videos(tmp_path)
    file = folder / "calibration.json"
    rig = json.loads(file.read_text())
    rig["cameras"]["Cam002"]["distortion_coefficients"] = [-0.1, 0.0, 0.0, 0.0, 0.0]
    file.write_text(json.dumps(rig))
    with pytest.raises(BadInput, match=r"camera Cam002: distortion .*Undistort .*--until gap"):
        preflight(load([f"capture.recording={folder}"]), "appearance")


@pytest.mark.parametrize("until", ["capture", "cloth"])
def test_skin_written_otherwise_is_refused_before_work(place, kept, capsys, until):
    """It would be simulated as cloth."""
    template(place, "g body", "g Body")
    assert submit(until=until) == 2
    said = capsys.readouterr().err
    assert "template.obj: it has a part 'Body'. Rename it to 'body'" in said
    assert contents(Path("artifacts")) == kept


def test_all_faults_are_told_at_once(place, capsys):
    BROKEN["truncated jpeg"](place)
    truncate(picture(place, camera="Cam004"))
    np.savez("not_smplx.npz", v_template=np.zeros((3, 3)))
    assert submit("--set", "body.model=not_smplx.npz", until="body") == 2
    said = capsys.readouterr().err
    assert all(word in said for word in ("Cam002_rgb000001", "Cam004_rgb000001", "not an SMPL-X model"))


def test_a_store_of_a_newer_format_is_refused_before_work(place, kept, capsys):
    version = Path("artifacts/STORE_VERSION")
    version.write_text('{"format": 99}')
    assert submit() == 2
    assert "upgrade physavatar" in capsys.readouterr().err
    assert contents(Path("artifacts")) == kept | {version: b'{"format": 99}'}


@pytest.fixture
def full_disk(tmp_path):
    """A file system of its own below the store."""
    root = tmp_path / "artifacts"
    root.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(root)], capture_output=True, check=False).returncode:
        pytest.skip("only root can mount a small tmpfs; the test of a disk that fills up meanwhile runs")
    yield root
    subprocess.run(["umount", str(root)], check=True)


@pytest.mark.parametrize("left", [0, 200_000])
def test_a_full_disk_is_refused_before_work(full_disk, place, kept, capsys, left):
    ballast = full_disk / "ballast"
    ballast.write_bytes(bytes(shutil.disk_usage(full_disk).free - left))
    assert submit() == 2
    said = capsys.readouterr().err
    assert all(word in said for word in ("no space left", "needed to begin", str(full_disk), "physavatar artifacts gc"))
    ballast.unlink()
    assert contents(Path("artifacts")) == kept


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_is_bad_input_wherever_it_strikes(code):
    """Records of a run and checkpoints are written outside of the store's own guard."""
    ended, said = ending_of(OSError(code, os.strerror(code), "artifacts/.runs/1.json"))
    assert ended == 2
    assert all(word in said for word in ("disk full", "artifacts/.runs/1.json", "physavatar artifacts gc"))


@pytest.mark.slow
def test_a_disk_that_fills_up_meanwhile_ends_with_2_and_can_be_gone_on_from(place, kept, capsys, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(artifact, "write_arrays", full)
    assert submit() == 2
    assert "no space left" in capsys.readouterr().err
    after = contents(Path("artifacts"))
    assert all(after[file] == content for file, content in kept.items())
    assert list(Path("artifacts").rglob(".tmp-*")) == []
    monkeypatch.undo()
    monkeypatch.chdir(place.parents[2])
    assert submit() == 0
    assert open_store("artifacts").verify() == []


@pytest.mark.slow
def test_a_sound_recording_is_captured_and_found_again(place, capsys):
    assert submit() == 0
    before = contents(Path("artifacts/ann"))
    assert any(file.name == "manifest.json" for file in before)
    BROKEN["truncated jpeg"](place)
    assert submit() == 2  # the store keeps what it had
    assert contents(Path("artifacts/ann")) == before
