"""Calibrated video: conventions of both calibration formats, frames by number, letterboxes."""

import json
import os
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tasks.capture.calibrated_video import read_calibrated_video
from tasks.capture.calibration_opencv import read_opencv, write_opencv
from tasks.capture.calibration_qualisys import read_qualisys
from tasks.capture.letterbox import find_letterbox
from tasks.capture.recording import to_y_up
from tasks.capture.video import Video
from tasks.geometry.cameras import Cameras, project
from tasks.geometry.faults import BadInput
from tests.capture.recordings import random_rig

REAL = Path(os.environ.get("PHYSAVATAR_REAL_DATA", Path(__file__).parents[2] / "../shared/data")) / "multiview"
real = pytest.mark.skipif(not REAL.is_dir(), reason=f"no recording at {REAL}; set PHYSAVATAR_REAL_DATA")
SIZE = (96, 64)
COUNT = 30


def distorted_rig(count: int = 2):
    K = np.array([[90.0, 0, 50], [0, 92, 30], [0, 0, 1]])
    distortion = np.array([-0.05, 0.1, 1e-3, -2e-3, 0.01])
    size = np.array(SIZE, np.int32)
    return replace(
        random_rig(1, count), **{k: np.tile(v, (count, *[1] * v.ndim)) for k, v in (("K", K), ("distortion", distortion), ("size", size))}
    )


def frame(number: int) -> np.ndarray:
    """A picture that carries its number in bits of white and black."""
    picture = np.full((SIZE[1], SIZE[0], 3), 90, np.uint8)
    for bit in range(6):
        picture[16:48, 16 * bit : 16 * bit + 16] = 255 if number >> bit & 1 else 0
    return picture


def number_in(picture: np.ndarray) -> int:
    return sum(1 << bit for bit in range(6) if picture[32, 16 * bit + 8].mean() > 128)


def write_video(path, pictures, fps=30.0):
    h, w = pictures[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), fps, (w, h))
    for picture in pictures:
        writer.write(picture)
    writer.release()


@pytest.fixture
def studio(tmp_path):
    rig = distorted_rig()
    write_opencv(tmp_path / "rig.json", rig)
    for name in rig.names:
        write_video(tmp_path / f"{name}.mp4", [frame(n) for n in range(COUNT)])
    return tmp_path / "rig.json", rig


# calibrations


def test_opencv_round_trip_and_agreement_with_cv2(tmp_path):
    rig = distorted_rig(4)
    write_opencv(tmp_path / "r.json", rig, up="z")
    back, up = read_opencv(tmp_path / "r.json")
    assert (back.names, up) == (rig.names, "z")
    for name in ("K", "R", "t", "size", "distortion"):
        np.testing.assert_allclose(getattr(back, name), getattr(rig, name), atol=1e-12)
    x = np.random.default_rng(0).normal(size=(60, 3)) * 3
    uv, depth = project(back, x)
    for k, entry in enumerate(json.loads((tmp_path / "r.json").read_text())["cameras"].values()):
        K, R, T, d = (np.array(entry[n]) for n in ("camera_matrix", "R", "T", "distortion_coefficients"))
        ahead = np.argsort(depth[k])[-3:]
        assert depth[k][ahead].min() > 0
        theirs = cv2.projectPoints(x[ahead], cv2.Rodrigues(R)[0], T, K, d)[0][:, 0] + 0.5  # they count pixel centres as integers
        np.testing.assert_allclose(uv[k][ahead], theirs, rtol=1e-9, atol=1e-6)


def test_opencv_yaml_written_by_opencv(tmp_path):
    rig = distorted_rig(2)
    write_opencv(tmp_path / "r.json", rig)
    (tmp_path / "yaml").mkdir()
    for name, entry in json.loads((tmp_path / "r.json").read_text())["cameras"].items():
        storage = cv2.FileStorage(str(tmp_path / "yaml" / f"{name}.yml"), cv2.FILE_STORAGE_WRITE)
        for key in ("image_width", "image_height"):
            storage.write(key, entry[key])
        for key in ("camera_matrix", "distortion_coefficients"):
            storage.write(key, np.array(entry[key]))
        storage.write("rvec", cv2.Rodrigues(np.array(entry["R"]))[0])
        storage.write("T", np.array(entry["T"]) * 1000)
        storage.write("unit", "mm")
        storage.release()
    back, _ = read_opencv(tmp_path / "yaml")
    for field in ("K", "R", "t", "distortion"):
        np.testing.assert_allclose(getattr(back, field), getattr(rig, field), atol=1e-9)


@pytest.mark.parametrize(
    "text",
    [
        "{}",
        "[]",
        '{"cameras": {}}',
        '{"cameras": {"a": 3}}',
        '{"cameras": {"../a": {}}}',
        '{"cameras": {"a": {"image_width": 1e400}}}',
        '{"cameras": {"a": {"image_width": 10, "image_height": 10, "camera_matrix": [NaN, 0, 0, 0, 1, 0, 0, 0, 1]}}}',
        '{"unit": "inch", "up": [], "cameras": {"a": {}}}',
        "[" * 100_000,
        "a: &a [1]\nb: *a\n",
        "!!python/object/apply:os.system ['false']",
        "\0",
    ],
)
def test_no_calibration(tmp_path, text):
    for name in ("r.json", "r.yml"):
        (tmp_path / name).write_text(text)
        with pytest.raises(BadInput):
            read_opencv(tmp_path / name)


def written(tmp_path: Path, change) -> Path:
    """A calibration of two cameras, changed as JSON."""
    write_opencv(tmp_path / "r.json", distorted_rig())
    content = json.loads((tmp_path / "r.json").read_text())
    change(content)
    (tmp_path / "r.json").write_text(json.dumps(content))
    return tmp_path / "r.json"


def renamed(old: str, new: str):
    return lambda content: content["cameras"]["Cam002"].update({new: content["cameras"]["Cam002"].pop(old)})


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (renamed("distortion_coefficients", "dist"), "Cam002: has the key 'dist', .* Did you mean 'distortion_coefficients'"),
        (renamed("distortion_coefficients", "distCoeffs"), "Cam002: .*'distCoeffs', .* Did you mean 'distortion_coefficients'"),
        (lambda content: content["cameras"]["Cam001"].update(k1=0.1), "Cam001: .*'k1', .* Known here: image_width, .*tvec"),
        (lambda content: content.update(units="mm"), "r.json: .*'units', .* Did you mean 'unit'"),
        (lambda content: content["cameras"]["Cam001"].update(fisheye_model=1), "Cam001: .*fisheye"),
    ],
)
def test_keys_that_nobody_knows_are_refused(tmp_path, change, says):
    with pytest.raises(BadInput, match=says):
        read_opencv(written(tmp_path, change))


def test_what_opencv_writes_beside_a_lens_is_left_aside(tmp_path):
    beside = {"calibration_time": "today", "nframes": 20, "board_width": 9, "flags": 0, "fisheye_model": 0, "image_points": []}
    back, _ = read_opencv(written(tmp_path, lambda content: content["cameras"]["Cam001"].update(beside)))
    np.testing.assert_allclose(back.distortion, distorted_rig().distortion)


def test_a_reflection_is_no_rotation(tmp_path):
    rig = distorted_rig()
    rig.R[1] *= -1
    write_opencv(tmp_path / "r.json", rig)
    with pytest.raises(BadInput, match="Cam002: R is no rotation"):
        read_opencv(tmp_path / "r.json")


@real
def test_qualisys_names_units_and_rotations():
    rig = read_qualisys(REAL / "Calib.qca.txt")
    assert rig.names == ("cam01", "cam02", "cam03", "cam04")
    assert (rig.size == [1088, 1920]).all()
    np.testing.assert_allclose(rig.centres()[0], [1.46023237, -1.90915905, 1.89650585], atol=1e-8)
    np.testing.assert_allclose(rig.K[0, 0, 2], 34110.316406 / 64 + 0.5)
    assert (rig.R[:, 2, 2] < 0).all()  # all look down on the treadmill
    assert (to_y_up(rig, "z").centres()[:, 1] > 1.6).all()


def write_qualisys(path: Path, rig: Cameras, *, corner: tuple[int, int] = (0, 0), digits: int = 17) -> None:
    """The rig as Qualisys has it: subpixels of a whole sensor, of which the video shows a part that begins at `corner`."""
    text = ""
    for k, name in enumerate(rig.names):
        (w, h), (left, top), (x, y, z) = rig.size[k], corner, (1000 * rig.centres()[k]).tolist()
        R = np.diag([1.0, -1, -1]) @ rig.R[k]
        pose = "".join(f'r{i + 1}{j + 1}="{R[i, j]:.{digits}f}" ' for i in range(3) for j in range(3))
        fu, fv, cu, cv = (64 * np.concatenate([rig.K[k].diagonal()[:2], rig.K[k, :2, 2] - 0.5 + corner])).tolist()
        text += (
            f'<camera serial="{name}"><fov_video left="{left}" top="{top}" right="{left + w - 1}" bottom="{top + h - 1}"/>'
            f'<transform {pose} x="{x}" y="{y}" z="{z}"/>'
            f'<intrinsic focalLengthU="{fu}" focalLengthV="{fv}" centerPointU="{cu}" centerPointV="{cv}"/></camera>'
        )
    path.write_text(f"<calibration>{text}</calibration>")


@pytest.mark.parametrize("corner", [(0, 0), (320, 72)])
def test_a_video_of_a_part_of_the_sensor_counts_from_its_own_corner(tmp_path, corner):
    rig = random_rig(3)
    write_qualisys(tmp_path / "c.qca.txt", rig, corner=corner)
    back = read_qualisys(tmp_path / "c.qca.txt")
    for field in ("K", "R", "t", "size"):
        np.testing.assert_allclose(getattr(back, field), getattr(rig, field), atol=1e-9)


def test_rotations_of_four_digits_become_rotations(tmp_path):
    """Off by more than 1e-4 as written, which a stored capture must not be: what is read is orthonormal, and as near to the truth."""
    rig = random_rig(1)
    rounded = replace(rig, R=rig.R.round(4))
    write_qualisys(tmp_path / "c.qca.txt", rig, digits=4)
    write_opencv(tmp_path / "r.json", rounded)
    assert 1e-4 < np.abs(rounded.R @ rounded.R.transpose(0, 2, 1) - np.eye(3)).max() < 1e-3
    qualisys, (opencv, _) = read_qualisys(tmp_path / "c.qca.txt"), read_opencv(tmp_path / "r.json")
    for back in (qualisys, opencv):
        np.testing.assert_allclose(back.R @ back.R.transpose(0, 2, 1), np.tile(np.eye(3), (5, 1, 1)), atol=1e-14)
        np.testing.assert_allclose(back.R, rig.R, atol=1e-4)
    np.testing.assert_allclose(qualisys.centres(), rig.centres(), atol=1e-12)  # the file's own
    np.testing.assert_allclose(opencv.t, rig.t, atol=1e-12)  # likewise


@real
@pytest.mark.parametrize("seed", range(30))
def test_damaged_qualisys_files(tmp_path, seed, damage):
    (tmp_path / "c.qca.txt").write_bytes((REAL / "Calib.qca.txt").read_bytes())
    damage(tmp_path / "c.qca.txt", np.random.default_rng(seed))
    with suppress(BadInput):
        read_qualisys(tmp_path / "c.qca.txt")


@real
def test_every_camera_with_a_number_out_of_range_is_named(tmp_path):
    text = (REAL / "Calib.qca.txt").read_text()
    (tmp_path / "c.qca.txt").write_text(text.replace('r11="0.55', 'r11="1e400').replace('focalLengthU="107118', 'focalLengthU="nan'))
    with pytest.raises(BadInput) as caught:
        read_qualisys(tmp_path / "c.qca.txt")
    assert [f.where.split(", ")[1] for f in caught.value.faults] == ["camera 1", "camera 2"]


def test_xml_that_explodes_is_not_expanded(tmp_path):
    entities = "".join(f'<!ENTITY e{k} "{f"&e{k - 1};" * 10 if k else "ha"}">' for k in range(12))
    (tmp_path / "c.qca.txt").write_text(f'<?xml version="1.0"?><!DOCTYPE x [{entities}]><x><camera serial="&e11;"/></x>')
    with pytest.raises(BadInput, match="document type"):
        read_qualisys(tmp_path / "c.qca.txt")


@pytest.mark.parametrize("seed", range(30))
def test_damaged_opencv_files(tmp_path, seed, damage):
    write_opencv(tmp_path / "r.json", distorted_rig())
    damage(tmp_path / "r.json", np.random.default_rng(seed))
    (tmp_path / "r.yml").write_bytes((tmp_path / "r.json").read_bytes())  # JSON is YAML
    for name in ("r.json", "r.yml"):
        with suppress(BadInput):
            read_opencv(tmp_path / name)


# videos


def test_frames_by_number_in_any_order(studio):
    video = Video(studio[0].with_name("Cam001.mp4"))
    assert (video.size, video.frame_count, video.fps) == (SIZE, COUNT, 30)
    for n in [0, 1, 2, 20, 5, 5, 29, 0, 13, 12]:
        assert number_in(video.read(n)) == n
    with pytest.raises(BadInput, match="ends after 30 frames"):
        video.read(30)
    assert number_in(video.read(3)) == 3


def test_calibrated_video(studio):
    calibration, rig = studio
    r = read_calibrated_video(calibration)
    np.testing.assert_allclose(r.cameras.K, rig.K)
    assert (len(r.frames), r.fps, r.mask, r.template) == (COUNT, 30, None, None)
    some = read_calibrated_video(calibration, cameras=["Cam002"], frames=[7, 3])
    assert some.cameras.names == ("Cam002",)
    assert [number_in(some.read_rgb(0, i)) for i in (0, 1)] == [3, 7]
    assert some.fps == 7.5
    assert "stand 4 apart" in some.warnings[0]
    with pytest.raises(BadInput, match="no masks"):
        r.read_mask(0, 0)
    with pytest.raises(BadInput, match="frames 0 to 29"):
        read_calibrated_video(calibration, frames=[30])
    with pytest.raises(BadInput, match="frame 5 follows frame 3, where others stand 1 apart"):
        read_calibrated_video(calibration, frames=[2, 3, 5, 6, 7])
    with pytest.raises(BadInput, match="no camera 'Cam009'"):
        read_calibrated_video(calibration, cameras=["Cam009"])


def test_videos_that_do_not_fit(studio):
    calibration, _ = studio
    write_video(calibration.with_name("Cam001.mp4"), [frame(n) for n in range(COUNT - 2)], fps=25)
    write_video(calibration.with_name("GoPro.mp4"), [frame(0)])
    with pytest.raises(BadInput) as caught:
        read_calibrated_video(calibration)
    assert "belongs to no camera" in str(caught.value)
    calibration.with_name("GoPro.mp4").unlink()
    with pytest.raises(BadInput) as caught:
        read_calibrated_video(calibration)
    assert "differ in frames: Cam001 28, Cam002 30" in str(caught.value)
    assert "differ in frames per second: Cam001 25" in str(caught.value)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "is no mp4"),
        (b"#EXTM3U\n#EXTINF:1,\nhttp://127.0.0.1:1/x.ts\n", "is no mp4"),  # never handed to FFmpeg, which would follow the address
        (b"\0\0\0\x20ftypisom" + b"\0" * 100, "cannot be opened as a video"),
    ],
)
def test_files_that_are_no_video(studio, content, says):
    calibration, _ = studio
    calibration.with_name("Cam002.mp4").write_bytes(content)
    with pytest.raises(BadInput, match=rf"Cam002\.mp4: {says}"):
        read_calibrated_video(calibration)


@pytest.mark.parametrize("seed", range(30))
def test_damaged_videos(studio, seed, damage):
    calibration, _ = studio
    damage(calibration.with_name("Cam001.mp4"), np.random.default_rng(seed))
    with suppress(BadInput):
        r = read_calibrated_video(calibration)
        [r.read_rgb(0, i) for i in range(len(r.frames))]


# letterboxes


def textured(width, height):
    rng = np.random.default_rng(0)
    return cv2.resize(rng.integers(60, 255, (height // 8, width // 8, 3), np.uint8), (width, height), interpolation=cv2.INTER_CUBIC)


def letterboxed(picture, width, height):
    h0, w0 = picture.shape[:2]
    s = min(width / w0, height / h0)
    M = np.array([[s, 0, (width - s * w0) / 2 + s / 2 - 0.5], [0, s, (height - s * h0) / 2 + s / 2 - 0.5]])
    return cv2.warpAffine(picture, M, (width, height), flags=cv2.INTER_AREA)


@pytest.mark.parametrize(("frame_size", "calibrated"), [((540, 960), (544, 960)), ((640, 300), (480, 300)), ((320, 240), (640, 480))])
def test_a_letterbox_is_found_and_the_lens_follows(frame_size, calibrated):
    padded = letterboxed(textured(*calibrated), *frame_size)[None]
    box = find_letterbox(padded, calibrated)
    K = np.array([[800.0, 0, 250], [0, 810, 140], [0, 0, 1]])
    corners = np.array([[0, calibrated[0]], [0, calibrated[1]], [1, 1.0]])
    seen = box.lens(K) @ np.linalg.inv(K) @ corners  # where the calibrated picture's corners land
    content = np.array(frame_size) - 2 * box.offset
    np.testing.assert_allclose(seen[:2, 1] - seen[:2, 0], content)
    np.testing.assert_allclose((seen[:2, 0] + seen[:2, 1]) / 2, np.array(frame_size) / 2)


def test_a_crop_is_no_letterbox():
    picture = textured(544, 960)
    assert find_letterbox(picture[None, :, 2:-2], (544, 960)) is None


def test_letterboxed_video_is_read_with_a_warning(studio):
    calibration, rig = studio
    write_video(
        calibration.with_name("Cam002.mp4"), [letterboxed(np.full((64, 96, 3), 40 + 5 * n, np.uint8), 96, 80) for n in range(COUNT)]
    )
    r = read_calibrated_video(calibration)
    assert "Cam002.mp4 shows 96 x 80 against 96 x 64" in r.warnings[0]
    assert r.cameras.size.tolist() == [[96, 64], [96, 80]]
    np.testing.assert_allclose(r.cameras.K[1] - rig.K[1], [[0, 0, 0], [0, 0, 8], [0, 0, 0]])


@real
@pytest.mark.slow
def test_real_letterboxes():
    """Of 1920 rows, content fills 1920 × 1080/1088 = 1905.9, measured below to half a row."""
    r = read_calibrated_video(REAL / "Calib.qca.txt")
    assert [w.split()[0] for w in r.warnings] == ["cam01.mp4", "cam02.mp4", "The"]
    assert all("7 + 7 black rows" in w for w in r.warnings[:2])
    assert (len(r.frames), r.fps, r.up) == (100, 60, "z")
    for k in (0, 1):
        rows = np.stack([r.read_rgb(k, i) for i in (0, 50, 99)]).astype(float).mean(axis=(0, 2, 3))
        filled = sum(np.clip(rows[:10] / rows[12], 0, 1)) + sum(np.clip(rows[-10:] / rows[-12], 0, 1)) + 1900
        assert abs(filled - 1920 * 1080 / 1088) < 0.5


@real
@pytest.mark.slow
@pytest.mark.parametrize("name", ["cam02.mp4", "cam03.mp4"])
def test_real_frames_by_number_equal_frames_in_order(name):
    """VP9 and H.264, against a second decoder pass that reads in order."""
    capture, in_order = cv2.VideoCapture(str(REAL / name)), {}
    for n in range(100):
        picture = capture.read()[1]
        in_order |= {n: picture} if n in (0, 17, 63, 64, 99) else {}
    video = Video(REAL / name)
    for n in (99, 17, 63, 64, 0):
        np.testing.assert_array_equal(video.read(n)[..., ::-1], in_order[n])
