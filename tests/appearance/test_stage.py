"""The door of appearance: it says how the fit ended, and refuses a choice that the rig cannot meet."""

import numpy as np
import pytest

from flows import config
from storage_schemas.tracking import Tracking
from tasks.appearance.colour import srgb8_from_linear
from tasks.appearance.pixels import shade
from tasks.appearance.stage import AppearanceParameters, appearance
from tasks.capture.stage import CaptureParameters, capture
from tasks.geometry.faults import BadInput
from tasks.stage import Job
from tests.appearance.stage_figure import blotches, dressed_scene
from tests.sequences import write_pictures

SIZE = 96


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    """Folder, and the tracked surface, of a figure in two frames and six cameras."""
    scene, texture = dressed_scene(frames=2, cameras=6, size=SIZE), blotches(64)
    light = scene.light(scene.trace(rays=64), texture)
    drawn = [[shade(scene.view(f, k, light[f], (64, 64)), texture) for k in range(6)] for f in range(2)]
    images = [[srgb8_from_linear(image) for image, _ in row] for row in drawn]
    folder = write_pictures(
        tmp_path_factory.mktemp("one"), scene.cameras, images, [[covered > 0.999 for _, covered in row] for row in drawn]
    )
    T, V = scene.vertices.shape[:2]
    surface = Tracking(
        vertices=scene.vertices.astype("float32"),
        faces=scene.faces,
        uv_vertices=scene.uv_vertices.astype("float32"),
        uv_faces=scene.uv_faces,
        part_names=("body",),
        part_of_face=np.zeros(len(scene.faces), "int32"),
        seen=np.ones((T, V), bool),
        noise_m=np.zeros((T, V), "float32"),
        photometric_rms=np.zeros(T, "float32"),
    )
    return folder, surface


def solve(sequence, **choices):
    """What the door publishes, its warnings, and the last it told of its progress."""
    folder, surface = sequence
    told, warned = [], []
    job = Job("ann", "one", folder, folder, lambda fraction, text: told.append(text), warned.append)
    seen = capture.function(job, CaptureParameters(recording=folder))
    warned.clear()
    found = appearance.function(job, seen, surface, AppearanceParameters(**{"texture_size": 64, "frames": 2} | choices))
    return found, warned, told[-1]


def test_a_texture_that_fits_the_pictures_is_told_of_and_not_warned_of(sequence):
    found, warned, last = solve(sequence)
    assert warned == [] and "texels observed" in last
    assert (found.gains[2] == 1).all() and np.isfinite(found.psnr).all()  # the camera that judges is scored and not fitted
    assert (found.gains[[0, 1, 3, 4, 5]] != 1).all()


def test_a_texture_too_fine_for_the_pictures_is_warned_of(sequence):
    _, warned, _ = solve(sequence, texture_size=256)
    assert len(warned) == 1 and "make the texture smaller" in warned[0]


def test_a_judge_that_is_not_in_the_rig_is_refused(sequence):
    with pytest.raises(BadInput, match="held_out: camera 6 of a rig of 6"):
        solve(sequence, held_out=6)


@pytest.mark.parametrize("choice", ["reduce=0", "frames=0", "texture_size=0", "held_out=-1"])
def test_choices_out_of_range_are_refused_before_anything_runs(choice, tmp_path):
    with pytest.raises(BadInput, match=choice.split("=")[0]):
        config.load([f"appearance.{choice}"], file=tmp_path / "none.toml")
