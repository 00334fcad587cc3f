"""Meshes, point caches, textures and videos are read back by somebody else's reader."""

import cv2
import numpy as np
import pytest
import trimesh

from tasks.export.frames import write_obj_frames, write_ply_frames
from tasks.export.influences import strongest
from tasks.export.point_cache import write_npz
from tasks.export.preview import shaded, write_video
from tasks.export.surface import Surface
from tasks.geometry.cameras import Cameras
from tasks.geometry.faults import BadInput
from tasks.geometry.rotations import matrix_from_axis_angle
from tests.export.avatars import FPS, tube


@pytest.fixture
def motion():
    surface = tube()
    return surface, surface.vertices + np.random.default_rng(0).normal(scale=0.01, size=(3, 1, 3))


def test_ply_frames_come_back_with_their_values(tmp_path, motion):
    surface, x = motion
    residual = np.arange(3 * len(surface.vertices)).reshape(3, -1) * 0.5
    paths = write_ply_frames(tmp_path / "new", "skirt", x, surface.faces, values={"residual_mm": residual})
    assert [path.name for path in paths] == ["skirt_0000.ply", "skirt_0001.ply", "skirt_0002.ply"]
    for frame, path in enumerate(paths):
        mesh = trimesh.load(path, process=False)
        assert np.abs(mesh.vertices - x[frame]).max() < 1e-7
        assert np.array_equal(mesh.faces, surface.faces)
        assert np.array_equal(mesh.metadata["_ply_raw"]["vertex"]["data"]["residual_mm"], residual[frame].astype("f4"))


def test_obj_frames_come_back_with_texture_and_parts(tmp_path, motion):
    surface, x = motion
    part = np.where(np.arange(len(surface.faces)) < 50, "skirt", "body")
    path = write_obj_frames(tmp_path, "all", x, surface.faces, uv_vertices=surface.uv_vertices, uv_faces=surface.uv_faces, part=part)[2]
    lines = [line.split() for line in path.read_text().splitlines()]
    numbers = [[corner.split("/") for corner in line[1:]] for line in lines if line[0] == "f"]
    assert np.abs(np.array([line[1:] for line in lines if line[0] == "v"], float) - x[2]).max() < 1e-6
    assert np.array_equal(np.array(numbers, int)[..., 0] - 1, surface.faces)
    assert np.array_equal(np.array(numbers, int)[..., 1] - 1, surface.uv_faces)
    assert [line[1] for line in lines if line[0] == "g"] == ["skirt", "body"]
    assert len(trimesh.load(path, process=False, force="mesh").faces) == len(surface.faces)


def test_obj_without_texture_is_plain(tmp_path, motion):
    surface, x = motion
    mesh = trimesh.load(write_obj_frames(tmp_path, "plain", x, surface.faces)[0], process=False)
    assert np.array_equal(mesh.faces, surface.faces)


def test_npz_is_tracked_geometry(tmp_path, motion):
    surface, x = motion
    path = write_npz(tmp_path / "track.npz", x, surface.faces, fps=FPS, mass_kg=0.3)
    with np.load(path, allow_pickle=False) as track:
        assert set(track) == {"vertices", "faces", "fps", "up", "mass_kg"}
        assert np.abs(track["vertices"] - x).max() < 1e-6
        assert (float(track["fps"]), str(track["up"])) == (FPS, "y")


def test_the_strongest_influences_are_kept():
    kept = strongest(np.array([[0.1, 0.5, 0.0, 0.4], [0.0, 0.0, 1.0, 0.0]]), 2)
    assert kept.joints.tolist() == [[1, 3], [2, 0]]
    assert np.allclose(kept.weights, [[5 / 9, 4 / 9], [1, 0]])
    assert np.allclose(kept.dropped, [0.1, 0])


def test_a_video_plays_at_its_rate_and_shows_its_images(tmp_path):
    """A grey ramp per frame, so that order, count and brightness are seen after lossy coding."""
    images = [np.full((64, 96, 3), 20 + 20 * frame, np.uint8) for frame in range(10)]
    images[3][:, 48:] = [200, 30, 30]
    video = cv2.VideoCapture(str(write_video(tmp_path / "preview.mp4", iter(images), fps=FPS)))
    seen = []
    while (got := video.read())[0]:
        seen.append(cv2.cvtColor(got[1], cv2.COLOR_BGR2RGB))
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(FPS)
    assert len(seen) == 10
    assert all(np.abs(image[:, :40].astype(int).mean() - (20 + 20 * frame)) < 4 for frame, image in enumerate(seen))
    assert np.abs(seen[3][20:40, 60:90].mean(axis=(0, 1)) - [200, 30, 30]).max() < 15  # red is red, not blue


def test_an_odd_size_is_rounded_up(tmp_path):
    """ActorsHQ at a quarter of its size is 747 x 1022."""
    video = cv2.VideoCapture(str(write_video(tmp_path / "odd.mp4", [np.full((33, 47, 3), 99, np.uint8)] * 3, fps=FPS)))
    assert video.read()[1].shape == (34, 48, 3)


def test_a_video_without_images_is_refused(tmp_path):
    with pytest.raises(BadInput, match="no frame"):
        write_video(tmp_path / "a.mp4", [], fps=FPS)
    assert not list(tmp_path.iterdir())


def facing_square(tilt: float = 0.0):
    """A square of 1 m, 2 m before a camera of 100 px at f = 100 px: it covers 50 px; turned by `tilt` about the vertical."""
    c, s = 0.5 * np.cos(tilt), 0.5 * np.sin(tilt)
    x = np.array([[-c, -0.5, 2 - s], [c, -0.5, 2 + s], [c, 0.5, 2 + s], [-c, 0.5, 2 - s]])
    R, t = matrix_from_axis_angle(np.array([[0.3, 2.0, -0.4]])), np.array([[0.5, -1.0, 4.0]])  # anywhere in the world
    x = (x - t) @ R[0]
    K = np.array([[[100, 0, 50], [0, 100, 50], [0, 0, 1.0]]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    camera = Cameras(("front",), K, R, t, np.array([[100, 100]]), np.zeros((1, 5)))
    return camera, Surface(x, faces, np.array([[0, 1], [1, 1], [1, 0], [0, 0.0]]), faces), x[None]


def test_shading_is_the_cosine_of_the_view():
    def brightness(tilt):
        (image,) = shaded(facing_square(tilt)[0], 0, *facing_square(tilt)[1:])
        return image[50, 50, 0] / 176

    assert brightness(0.0) == pytest.approx(1, abs=0.02)
    for tilt in (0.5, 1.0):
        assert brightness(tilt) == pytest.approx(0.25 + 0.75 * np.cos(tilt), abs=0.06)  # the lamp is near, so its angle varies a little


def test_the_texture_is_the_right_way_up():
    camera, surface, x = facing_square()
    texture = np.zeros((2, 2, 3), np.uint8)
    texture[0, 0], texture[0, 1], texture[1, 0] = [255, 0, 0], [0, 255, 0], [0, 0, 255]
    (image,) = shaded(camera, 0, surface, x, texture=texture)
    assert image[30, 30].argmax() == 0  # up is -y in the camera: v = 1, row 0
    assert image[30, 70].argmax() == 1
    assert image[70, 30].argmax() == 2
    assert (image[10, 10] == 255).all()
    assert 49 <= (image != 255).any(axis=-1)[50].sum() <= 51
