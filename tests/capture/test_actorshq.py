"""ActorsHQ folders: the layout's geometry, and every fault of a broken recording found at once."""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from tasks.capture.actorshq import find_sequence, read_actorshq
from tasks.capture.calibration_actorshq import COLUMNS, read_calibration_csv, write_calibration_csv
from tasks.geometry.cameras import project
from tasks.geometry.faults import BadInput
from tests.capture.recordings import FRAMES, NAMES, TRIANGLE, mask, mask_of, picture, random_rig, ring, write_sequence


@pytest.fixture
def sequence(tmp_path):
    return write_sequence(tmp_path)


def faults_of(*args, **kwargs) -> list[str]:
    with pytest.raises(BadInput) as caught:
        read_actorshq(*args, **kwargs)
    return [str(f) for f in caught.value.faults]


# calibration.csv


@pytest.mark.parametrize("seed", range(5))
def test_calibration_survives_a_round_trip(tmp_path, seed):
    rig = random_rig(seed)
    write_calibration_csv(tmp_path / "c.csv", rig)
    back = read_calibration_csv(tmp_path / "c.csv")
    assert back.names == rig.names
    assert (back.size == rig.size).all()
    for name in ("K", "R", "t"):
        np.testing.assert_allclose(getattr(back, name), getattr(rig, name), rtol=0, atol=1e-10)


def test_convention_by_hand_written_row(tmp_path):
    """A camera at (-3, 1, 0) turned by 120° about (1, 1, 1), which takes its x (right) to world y, its y (down) to z, its z (forward) to x.

    So it lies on its side: what is higher appears further right. The opposite turn, world to camera, would look along y.
    """
    r = "1.2091995761561452"
    row = f"Cam001, 200, 100, {r}, {r}, {r}, -3, 1, 0, 0.5, 1.0, 0.5, 0.5"  # with the spaces that ActorsHQ's README prints
    (tmp_path / "c.csv").write_text(", ".join(COLUMNS) + "\n" + row + "\n")
    rig = read_calibration_csv(tmp_path / "c.csv")
    uv, depth = project(rig, np.array([[0, 1, 0], [0, 1.3, 0], [0, 1, 0.3]]))
    np.testing.assert_allclose(uv[0], [[100, 50], [110, 50], [100, 60]], atol=1e-9)
    np.testing.assert_allclose(depth[0], 3)


def test_against_actorshq_own_unprojection(tmp_path):
    """Independent route: scipy's rotation of the file's axis-angle as camera-to-world, X = C + s R K⁻¹ (u, v, 1)."""
    rig = random_rig(7)
    write_calibration_csv(tmp_path / "c.csv", rig)
    x = np.array([0.2, 0.9, -0.1])
    uv, depth = project(read_calibration_csv(tmp_path / "c.csv"), x)
    with (tmp_path / "c.csv").open() as file:
        for k, row in enumerate(csv.DictReader(file)):
            v = {n: float(row[n]) for n in COLUMNS[1:]}
            ray = np.array([(uv[k, 0] / v["w"] - v["px"]) / v["fx"], (uv[k, 1] / v["h"] - v["py"]) / v["fy"], 1])
            if depth[k] > 0:
                offset = Rotation.from_rotvec([v["rx"], v["ry"], v["rz"]]).apply(depth[k] * ray)
                np.testing.assert_allclose(offset + np.array([v["tx"], v["ty"], v["tz"]]), x, atol=1e-9)
    assert (depth > 0).any()


def test_lenses_are_not_written_with_distortion(tmp_path):
    rig = random_rig(0)
    rig.distortion[2, 0] = 0.1
    with pytest.raises(BadInput, match="Cam003: has distortion"):
        write_calibration_csv(tmp_path / "c.csv", rig)


@pytest.mark.parametrize(
    ("column", "value", "says"),
    [
        ("rx", "nan", "Cam002 has values out of range"),
        ("tx", "inf", "Cam002 has values out of range"),
        ("w", "64.5", "Cam002 has values out of range"),
        ("fx", "", "could not convert"),
        ("fx", "0", "focal lengths"),
        ("px", "320", "principal point"),
        ("name", "../../etc", "is no name"),
        ("name", "Cam001", "Cam001 occurs 2 times"),
        ("h", "0", "out of range"),
    ],
)
def test_faults_in_a_calibration_row(sequence, column, value, says):
    path = sequence / "4x" / "calibration.csv"
    with path.open() as file:
        rows = list(csv.DictReader(file))
    rows[1][column] = value
    path.write_text("\n".join([",".join(COLUMNS), *(",".join(r.values()) for r in rows)]))
    assert says in "\n".join(faults_of(sequence))


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_cameras_in_kilometres_or_millimetres_are_named(tmp_path, factor):
    rig = ring()
    rig.t[:] *= factor
    write_calibration_csv(tmp_path / "c.csv", rig)
    with pytest.raises(BadInput, match="must be in metres"):
        read_calibration_csv(tmp_path / "c.csv")


# the folder


def test_a_sound_sequence_is_read_whole(sequence):
    for folder, scale in ((sequence, None), (sequence, "4x"), (sequence / "4x", None)):
        r = read_actorshq(folder, scale=scale, deep=True)
        assert r.cameras.names == NAMES
        assert r.frames.tolist() == list(FRAMES)
        assert (r.fps, r.up, r.mass_kg, r.warnings) == (25.0, "y", 0.3, ())
    assert r.read_rgb(2, 1).shape == (64, 48, 3)  # the upright one
    stored = np.asarray(Image.open(picture(sequence, "Cam002", 2)))
    np.testing.assert_array_equal(r.read_rgb(1, 2), stored)
    np.testing.assert_array_equal(r.read_mask(0, 0), mask_of(64, 48) > 0)
    assert r.read_template().vertices.shape == (3, 3)
    assert (r.root / r.path(1, 2)[0]).exists()


def test_cameras_and_frames_can_be_selected_in_any_order(sequence):
    picture(sequence, "Cam001", 0).unlink()  # not selected, not looked at
    r = read_actorshq(sequence, cameras=["Cam127", "Cam002"], frames=[2, 1])
    assert r.cameras.names == ("Cam127", "Cam002")
    assert r.frames.tolist() == [1, 2]
    assert "Cam127_rgb000001.jpg" in r.path(0, 0)[0]
    assert "no camera 'Cam009'" in faults_of(sequence, cameras=["Cam009"])[0]
    assert "frames are missing" in faults_of(sequence, frames=[1, 99])[0]


def test_every_other_frame_has_half_the_rate(sequence):
    r = read_actorshq(sequence, frames=[0, 2])
    assert r.fps == 12.5
    assert any("stand 2 apart" in w and "12.5" in w for w in r.warnings)


def test_a_frame_that_no_camera_has_is_a_gap(tmp_path):
    sequence = write_sequence(tmp_path, frames=range(5))
    for name in NAMES:
        picture(sequence, name, 3).unlink()
        mask(sequence, name, 3).unlink()
    (found,) = faults_of(sequence)
    assert str(sequence / "4x") in found
    assert "frame 4 follows frame 2" in found
    assert read_actorshq(sequence, frames=[0, 1, 2]).fps == 25


def test_the_remedy_for_missing_pictures_is_one_that_helps(tmp_path):
    """Frames left out in the middle were advised, and are refused: the rate would be wrong."""
    sequence = write_sequence(tmp_path, frames=range(5))
    picture(sequence, "Cam002", 2).unlink()
    (found,) = faults_of(sequence)
    assert "leave the camera out, or select evenly spaced frames" in found
    assert "frame 3 follows frame 1" in faults_of(sequence, frames=[0, 1, 3, 4])[0]
    assert read_actorshq(sequence, cameras=["Cam001", "Cam127"]).frames.tolist() == [0, 1, 2, 3, 4]


def at_frame(sequence: Path, number: int) -> Path:
    """A mesh of that frame, as ActorsHQ has them."""
    (sequence / "meshes").mkdir(exist_ok=True)
    file = sequence / "meshes" / f"Frame{number:06d}.obj"
    file.write_text(TRIANGLE)
    return file


def test_the_template_of_another_frame_gives_way_to_a_mesh_of_the_first_that_is_read(sequence):
    mesh = at_frame(sequence, 1)
    r = read_actorshq(sequence, frames=[1, 2])
    assert r.template == mesh
    (warning,) = r.warnings[1:]  # the first is of scene.json
    assert "template.obj shows frame 0" in warning
    assert f"frame 1 is the first that is read: {mesh} is taken" in warning


def test_the_template_of_another_frame_is_taken_with_a_warning(sequence):
    r = read_actorshq(sequence, frames=[1, 2])
    assert r.template == sequence / "template" / "template.obj"
    assert "shows frame 0, the recording's first, and frame 1 is the first that is read: unless" in r.warnings[1]


def test_at_the_first_frame_the_template_goes_before_a_mesh_without_parts(sequence):
    """Both are of frame 0, and only the template tells garments from skin."""
    mesh = at_frame(sequence, 0)
    r = read_actorshq(sequence)
    assert (r.template, r.warnings) == (sequence / "template" / "template.obj", ())
    r.template.unlink()
    assert read_actorshq(sequence).template == mesh


def test_a_surface_without_skin_is_told(sequence):
    """A modelling program writes the object's name over all faces."""
    (sequence / "template" / "template.obj").write_text("o Scan_01\n" + TRIANGLE)
    (warning,) = read_actorshq(sequence).warnings
    assert "no part 'body'" in warning
    assert "Scan_01" in warning


def test_z_up_recordings_are_turned_with_their_template(sequence):
    flat = read_actorshq(sequence)
    (sequence / "physavatar.json").write_text(json.dumps({"up": "z", "fps": 30}))
    turned = read_actorshq(sequence)
    assert (turned.up, turned.fps) == ("z", 30)
    x = np.array([0.3, -0.2, 1.1])
    before = project(flat.cameras, x)[0]
    after = project(turned.cameras, np.array([0.3, 1.1, 0.2]))[0]  # (x, y, z) -> (x, z, -y)
    np.testing.assert_allclose(after, before, atol=1e-9)
    np.testing.assert_allclose(turned.read_template().vertices[2], [0, 0, -1], atol=1e-12)  # the vertex (0, 1, 0)


def test_a_recording_without_masks_is_legal(sequence):
    shutil.rmtree(sequence / "4x" / "masks")
    r = read_actorshq(sequence)
    assert r.mask is None
    assert "no masks" in r.warnings[0]
    with pytest.raises(BadInput, match="no masks"):
        r.read_mask(0, 0)


def test_every_fault_is_found_at_once(sequence):
    picture(sequence, "Cam001", 1).unlink()
    short = picture(sequence, "Cam002", 2)
    short.write_bytes(short.read_bytes()[:-400])
    Image.new("RGB", (10, 10)).save(picture(sequence, "Cam002", 0))
    Image.new("L", (48, 64)).save(mask(sequence, "Cam127", 0))
    Image.new("L", (48, 64)).save(mask(sequence, "Cam127", 1))
    (sequence / "4x" / "rgbs" / "Cam050").mkdir()
    aabbs = sequence / "aabbs.csv"
    aabbs.write_text(aabbs.read_text().replace("1.7", "1700"))
    (sequence / "physavatar.json").write_text('{"fps": NaN, "weight": 3, "up": "x"}')
    found = faults_of(sequence)
    for says in (
        "1 of 3 frames are missing: 000001",
        "Cam002_rgb000002.jpg: cannot be decoded (image file is truncated",
        "Cam002_rgb000000.jpg: is 10 x 10 pixels where the calibration says 64 x 48",
        "is an empty mask; so are 1 more of this camera: Cam127_mask000001.png",
        "Cam050: has pictures but no row",
        "person of 1700 m",
        "fps is nan",
        "'weight' is not understood",
        "up is 'x'",
    ):
        assert sum(says in f for f in found) == 1, says
    assert len(found) == 9


def test_the_first_mask_of_every_camera_is_decoded(sequence):
    """Of another range than 0 to 255, and too large a file to look empty; the later ones are as it is."""
    for name in NAMES[:2]:
        for frame in FRAMES:
            Image.fromarray(np.random.default_rng(0).integers(0, 101, (48, 64), np.uint8)).save(mask(sequence, name, frame))
    found = faults_of(sequence)
    assert [f.split(":")[0] for f in found] == [str(mask(sequence, name, 0)) for name in NAMES[:2]]
    assert all("with 100 as the largest value in channel 0" in f for f in found)
    mask(sequence, "Cam001", 0).unlink()  # frame 1 is then the first
    assert str(mask(sequence, "Cam001", 1)) in faults_of(sequence, cameras=["Cam001"], frames=[1, 2])[0]


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("v 1 0 0", "v 1000 0 0", "metres"),
        ("v 1 0 0", "v 0 0 0", "lie exactly on others"),
        ("v 0 0 0", "g Body\nv 0 0 0", "a part 'Body'"),
        ("v 0 0 0", "g upper/skirt\nv 0 0 0", "a part 'upper/skirt'"),
    ],
)
def test_a_template_that_cannot_be_tracked_is_told_with_all_else(sequence, old, new, says):
    template = sequence / "template" / "template.obj"
    template.write_text(TRIANGLE.replace(old, new))
    picture(sequence, "Cam001", 1).unlink()
    found = faults_of(sequence)
    assert "frames are missing" in found[0]
    assert any(f.startswith(str(template)) and says in f for f in found[1:])


def test_camera_without_pictures(sequence):
    shutil.rmtree(sequence / "4x" / "rgbs" / "Cam002")
    assert "no pictures" in faults_of(sequence)[0]


@pytest.mark.parametrize("height", ["0.0017", "1700"])
def test_absurd_boxes(sequence, height):
    aabbs = sequence / "aabbs.csv"
    side = str(float(height) / 4)
    aabbs.write_text(aabbs.read_text().replace("0.5", side).replace("1.7", height))
    assert "imply a person" in faults_of(sequence)[0]


def test_frames_without_a_box_are_a_warning(sequence):
    aabbs = sequence / "aabbs.csv"
    aabbs.write_text("\n".join(aabbs.read_text().splitlines()[:-1]))
    assert "lacks 1 frames (2)" in read_actorshq(sequence).warnings[0]


def test_folders_that_are_not_there(tmp_path, sequence):
    assert find_sequence(tmp_path, "Actor01", "Sequence1") == sequence
    with pytest.raises(BadInput, match="It holds: Actor01"):
        find_sequence(tmp_path, "Actor02", "Sequence1")
    for name in ("..", "../Actor01", "/etc", "", ".", "a/b", "a\0b"):
        with pytest.raises(BadInput, match="is no name"):
            find_sequence(tmp_path, name, "Sequence1")
    assert "is no folder" in faults_of(tmp_path / "nowhere")[0]
    assert "Choose one of: 4x" in faults_of(sequence, scale="1x")[0]
    assert "is no name" in faults_of(sequence, scale="../4x")[0]


def test_two_scales_must_be_chosen_from(sequence):
    shutil.copytree(sequence / "4x", sequence / "1x")
    assert "Choose one of: 1x, 4x" in faults_of(sequence)[0]
    assert read_actorshq(sequence, scale="1x").root.name == "1x"


# malformed bytes


@pytest.mark.parametrize("seed", range(30))
def test_damaged_files_give_bad_input_or_a_recording(tmp_path, seed, damage):
    sequence = write_sequence(tmp_path)
    rng = np.random.default_rng(seed)
    files = sorted(p for p in sequence.rglob("*") if p.suffix in (".csv", ".json", ".jpg", ".png", ".obj"))
    named = [p for p in files if p.suffix in (".csv", ".json", ".obj")]
    damage(named[rng.integers(len(named))] if seed % 2 else files[rng.integers(len(files))], rng)
    try:
        recording = read_actorshq(sequence, deep=True)
        recording.read_template()
        [recording.read_rgb(k, f) for k in range(3) for f in range(len(recording.frames))]
    except BadInput:
        pass
