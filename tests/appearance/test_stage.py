"""The door of appearance: whose skin it takes, what it says of how the fit ended, and that a choice the rig cannot meet is refused."""

import numpy as np
import pytest

from flows import config
from storage_schemas.skinning import Skinning
from storage_schemas.tracking import Tracking
from tasks.appearance.colour import srgb8_from_linear
from tasks.appearance.pixels import shade
from tasks.appearance.stage import AppearanceParameters, appearance
from tasks.capture.stage import CaptureParameters, capture
from tasks.geometry.faults import BadInput
from tasks.stage import Job
from tests.appearance.stage_figure import blotches, dressed_scene
from tests.sequences import write_pictures
from tests.storage_schemas.examples import examples

SIZE = 96
BODY = 160  # vertices of the figure's body, its first


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    """Folder, and the tracked surface, of a figure that stands still in its waving skirt: two frames and six cameras."""
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
        part_names=("body", "skirt"),
        part_of_face=(scene.faces[:, 0] >= BODY).astype("int32"),
        seen=np.ones((T, V), bool),
        noise_m=np.zeros((T, V), "float32"),
        photometric_rms=np.zeros(T, "float32"),
    )
    return folder, surface


def standing(surface):
    """A body that does not move, and skin that hangs on its first joint as it is in the first frame."""
    frames, vertices = surface.vertices.shape[:2]
    transforms = np.tile(np.eye(4, dtype="float32"), (frames, 55, 1, 1))
    body = examples()["registration"].model_copy(update={"transforms": transforms})
    return body, Skinning(
        weights=np.eye(55, dtype="float32")[[0] * vertices], matched=np.ones(vertices, bool), rest_vertices=surface.vertices[0]
    )


def solve(sequence, tracked=None, **choices):
    """What the door publishes, its warnings, and the last it told of its progress."""
    folder, surface = sequence
    told, warned = [], []
    job = Job("ann", "one", folder, folder, lambda fraction, text: told.append(text), warned.append)
    seen = capture.function(job, CaptureParameters(recording=folder))
    warned.clear()
    parameters = AppearanceParameters(**{"texture_size": 64, "frames": 2} | choices)
    found = appearance.function(job, seen, tracked or surface, *standing(surface), parameters)
    return found, warned, told[-1]


def test_a_texture_that_fits_the_pictures_is_told_of_and_not_warned_of(sequence):
    found, warned, last = solve(sequence)
    assert warned == [] and "texels observed" in last
    assert (found.gains[2] == 1).all() and np.isfinite(found.psnr).all()  # the camera that judges is scored and not fitted
    assert (found.gains[[0, 1, 3, 4, 5]] != 1).all()


def test_skin_is_where_the_body_carries_it_unless_nobody_knows_what_is_skin(sequence):
    """Skin tracked 8 cm outside itself shows through the skirt."""
    surface, x = sequence[1], sequence[1].vertices.copy()
    x[:, :BODY] *= np.float32([1.5, 1, 1.5])
    through = surface.model_copy(update={"vertices": x})
    one_piece = through.model_copy(update={"part_names": ("body",), "part_of_face": np.zeros_like(surface.part_of_face)})
    right, carried, as_tracked = (solve(sequence, tracked)[0] for tracked in (surface, through, one_piece))
    assert np.array_equal(carried.psnr, right.psnr) and np.array_equal(carried.albedo, right.albedo)
    assert np.nanmean(as_tracked.psnr) < np.nanmean(right.psnr) - 3


def test_a_texture_too_fine_for_the_pictures_is_warned_of(sequence):
    _, warned, _ = solve(sequence, texture_size=256)
    assert len(warned) == 1 and "make the texture smaller" in warned[0]


def test_a_judge_that_is_not_in_the_rig_is_refused(sequence):
    with pytest.raises(BadInput, match="held_out: camera 6 of a rig of 6"):
        solve(sequence, held_out=6)


@pytest.mark.parametrize("choice", ["reduce=0", "frames=0", "texture_size=0", "held_out=-1"])
def test_choices_out_of_range_are_refused_before_anything_runs(choice, tmp_path):
    empty = tmp_path / "empty.toml"
    empty.touch()
    with pytest.raises(BadInput, match=choice.split("=")[0]):
        config.load([f"appearance.{choice}"], file=empty)
