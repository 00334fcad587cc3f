"""Whatever is wrong with an input, `submit` ends with 2 before any work, names the file and the remedy, and leaves the store as it was."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from flows import cli
from tests.flows.recordings import tiny_recording


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
    "template winding": lambda f: template(f, "f 1 2 4", "f 2 1 4"),
}


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tiny_recording(tmp_path / "data")


def submit(*more: str, until: str = "capture") -> int:
    with pytest.raises(SystemExit) as ended:
        cli.main(["submit", "ann", "--until", until, *more])
    return ended.value.code


def artifacts(root: Path) -> list[Path]:
    return sorted(root.rglob("manifest.json"))


@pytest.mark.parametrize("what", BROKEN)
def test_a_broken_recording_is_refused_before_work(place, capsys, what):
    BROKEN[what](place)
    assert submit() == 2
    said = capsys.readouterr().err
    assert "fault" in said
    assert str(Path("data/ann/one")) in said
    assert artifacts(Path("artifacts")) == []


def test_a_file_that_is_no_body_model_is_refused_before_work(place, capsys):
    np.savez("not_smplx.npz", v_template=np.zeros((3, 3)))
    assert submit("--set", "body.model=not_smplx.npz", until="body") == 2
    assert "not an SMPL-X model" in capsys.readouterr().err
    assert artifacts(Path("artifacts")) == []


def test_all_faults_are_told_at_once(place, capsys):
    BROKEN["truncated jpeg"](place)
    truncate(picture(place, camera="Cam004"))
    np.savez("not_smplx.npz", v_template=np.zeros((3, 3)))
    assert submit("--set", "body.model=not_smplx.npz", until="body") == 2
    said = capsys.readouterr().err
    assert all(word in said for word in ("Cam002_rgb000001", "Cam004_rgb000001", "not an SMPL-X model"))


@pytest.mark.slow
def test_a_sound_recording_is_captured_and_found_again(place, capsys):
    assert submit() == 0
    before = artifacts(Path("artifacts"))
    assert len(before) == 1
    BROKEN["truncated jpeg"](place)
    assert submit() == 2  # the store keeps what it had
    assert artifacts(Path("artifacts")) == before
