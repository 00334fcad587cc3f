"""`physavatar capture`: what is refused, and that it is refused before a picture is read."""

import json

import numpy as np
import pytest
from PIL import Image

from flows import cli
from tasks.capture import images
from tests.capture.recordings import write_sequence

BLANK = np.full((24, 32, 3), 100, np.uint8)


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        cli.main([str(a) for a in arguments])
    return ended.value.code


def test_a_check_tells_what_submit_would(tmp_path, capsys):
    sequence = write_sequence(tmp_path)
    assert run("capture", "check", sequence) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 3
    template = sequence / "template" / "template.obj"
    template.write_text("g Body\n" + template.read_text())
    assert run("capture", "check", sequence) == 2
    assert "a part 'Body'" in capsys.readouterr().err


@pytest.fixture
def pictures(tmp_path, monkeypatch):
    """A picture of each of three cameras, and a folder of each with two: none may be read."""
    monkeypatch.setattr(images, "read_rgb", lambda path: pytest.fail(f"{path} was read"))
    for name in ("cam1", "cam2", "cam3"):
        for number in (0, 1):
            (tmp_path / "boards" / name).mkdir(parents=True, exist_ok=True)
            Image.fromarray(BLANK).save(tmp_path / "boards" / name / f"{number}.png")
        (tmp_path / "pictures").mkdir(exist_ok=True)
        Image.fromarray(BLANK).save(tmp_path / "pictures" / f"{name}.png")
    monkeypatch.chdir(tmp_path)
    return tmp_path


BOARD, BASELINE = ("--board", "9x6x0.06x0.045"), ("--baseline", "cam1", "cam2", "1.5")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("nowhere", "c.json", *BASELINE), ["nowhere: is no folder"]),
        (("nowhere", "c.json", *BOARD), ["nowhere: is no folder"]),
        (("pictures", "there/is/none/c.json", *BASELINE), ["there is no folder there/is/none"]),
        (("boards", "pictures", *BOARD), ["pictures: is a folder"]),
        (("pictures", "c.json"), ["baseline: there is none"]),
        (("pictures", "c.json", "--baseline", "cam1", "cam9", "1.5"), ["no camera 'cam9'", "Name two of cam1, cam2, cam3"]),
        (("pictures", "c.json", "--baseline", "cam1", "cam2", "-1.5"), ["baseline: is ('cam1', 'cam2', -1.5)", "metres"]),
        (("boards", "c.json", "--board", "9x6"), ["board: '9x6' is not understood", "9x6x0.06x0.045"]),
        (("boards", "c.json", "--board", "9x6x0.06x0.07"), ["markers of 0.07 m on squares of 0.06 m"]),
        (("boards", "c.json", "--board", "1x1x0.06x0.045"), ["1 x 1 squares"]),
        (("pictures", "c.json", *BOARD), ["pictures: it holds no folders"]),
        (("nowhere", "none/c.json", "--board", "1x1x0.06x0.07"), ["4 faults"]),
    ],
)
def test_a_calibration_that_cannot_be_is_refused_before_work(pictures, capsys, arguments, said):
    assert run("capture", "calibrate", *arguments) == 2
    told = capsys.readouterr().err
    assert all(word in told for word in said), told
    assert not list(pictures.rglob("c.json"))


@pytest.mark.parametrize(("folder", "option"), [("pictures", BASELINE), ("boards", BOARD)])
def test_cameras_that_no_reader_would_name_are_refused_before_work(pictures, capsys, folder, option):
    old = pictures / folder / ("cam3.png" if folder == "pictures" else "cam3")
    new = old.rename(old.with_name(old.name.replace("cam3", "cam 3")))
    assert run("capture", "calibrate", folder, "c.json", *option) == 2
    assert f"{new.relative_to(pictures)}: 'cam 3' is no name" in capsys.readouterr().err


def test_cameras_of_unequal_or_no_pictures_are_refused_before_work(pictures, capsys):
    for keep in (1, 0):
        for camera in sorted((pictures / "boards").iterdir())[: 1 if keep else 3]:
            [p.unlink() for p in sorted(camera.iterdir())[keep:]]
        assert run("capture", "calibrate", "boards", "c.json", *BOARD) == 2
        assert f"it holds {{'cam1': {keep}, 'cam2': {2 * keep}" in capsys.readouterr().err
