"""Pictures: the camera sees points where the projection says, the same picture comes twice, masks and colours are what was asked for."""

import io

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import binary_dilation

from tasks.capture.demo.pictures import develop, encode
from tasks.capture.demo.rendering import Renderer, Surface
from tasks.capture.demo.rig import ring_cameras
from tasks.geometry.cameras import Cameras, project

SQUARE = np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def camera(size: tuple[int, int], principal: tuple[float, float]) -> Cameras:
    """At the origin, looking along +z with y down."""
    K = np.array([[[100.0, 0, principal[0]], [0, 100.0, principal[1]], [0, 0, 1]]])
    return Cameras(("Cam001",), K, np.eye(3)[None], np.zeros((1, 3)), np.array([size], np.int32), np.zeros((1, 5)))


def plate(centre: list[float], half: float) -> np.ndarray:
    return np.array(centre) + half * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])


@pytest.mark.parametrize("principal", [(32.0, 24.0), (36.5, 19.0)])
def test_the_camera_sees_points_where_they_project(principal) -> None:
    """A plate off centre, in a wide picture with the principal point off centre: its edges and its middle are where `project` says."""
    cameras = camera((64, 48), principal)
    x = plate([0.1, -0.05, 1.0], 0.06)
    colour, coverage = Renderer([Surface("plate", SQUARE, colours=np.full((4, 3), 0.5))], [x], spp=64).render(cameras, 0, seed=1)
    uv, _ = project(cameras, x)
    assert coverage.shape == (48, 64)
    assert coverage.sum() == pytest.approx(12 * 12, rel=0.01)
    i, j = np.indices(coverage.shape) + 0.5
    middle = np.array([(coverage * j).sum(), (coverage * i).sum()]) / coverage.sum()
    np.testing.assert_allclose(middle, uv[0].mean(0), atol=0.05)
    assert np.abs(colour[coverage == 1] - 0.5).max() < 0.02  # albedo ½ under a sky of 1, up to noise


def test_textures_stand_upright() -> None:
    """u to the right and v up on the plate; row 0 of the texture is v = 1. Red in the upper left corner only."""
    texture = np.full((64, 64, 3), 0.2, np.float32)
    texture[:32, :32, 0] = 0.8
    x = plate([0, 0, 1.0], 0.2)[[3, 2, 1, 0]]  # y down: the first corner is the lower left of the picture
    surface = Surface("plate", SQUARE, uv=np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]]), texture=texture)
    colour, _ = Renderer([surface], [x], spp=16).render(camera((64, 64), (32.0, 32.0)), 0, seed=1)
    red = colour[..., 0] > 0.5
    i, j = np.nonzero(red)
    assert (i.max(), j.max()) == (31, 31) and (i.min(), j.min()) == (12, 12)


def test_truth_lands_on_the_mask_and_the_picture_repeats(plan) -> None:
    """At least 99 % of all vertices project onto the mask or within two pixels of it; same seed, same bytes; other seed, other bytes."""
    x = plan.surface_vertices({n: f.garment.vertices[None] for n, f in plan.fittings.items()}, 0)
    renderer = Renderer(plan.surfaces, x, spp=4)
    for k in range(len(plan.cameras)):
        first, second, other = (photo(plan, renderer, k, seed) for seed in (5, 5, 6))
        assert first == second != other
        mask = binary_dilation(np.array(Image.open(io.BytesIO(first[1]))) > 0, iterations=2)  # hems lie on the outline itself
        j, i = np.floor(project(plan.cameras.subset([k]), np.concatenate(x))[0][0]).astype(int).T
        assert mask[i, j].mean() > 0.99
    renderer.move([y + np.array([0.3, 0, 0]) for y in x])
    moved = np.array(Image.open(io.BytesIO(photo(plan, renderer, 0, 5)[1]))) > 0
    j, i = np.floor(project(plan.cameras.subset([0]), np.concatenate(x))[0][0]).astype(int).T
    assert moved[i, j].mean() < 0.9


def photo(plan, renderer: Renderer, k: int, seed: int) -> tuple[bytes, bytes]:
    return develop(*renderer.render(plan.cameras, k, seed=seed), plan.gains[k], np.random.default_rng(0))


def test_masks_waver_by_a_pixel_and_blacken_what_they_leave_out() -> None:
    i, j = np.indices((200, 200)) + 0.5
    disc = (np.hypot(i - 100, j - 100) < 60).astype(np.float32)
    jpeg, png = develop(np.repeat(disc[..., None], 3, 2) * 0.5, disc, np.ones(3), np.random.default_rng(0))
    mask, picture = (np.array(Image.open(io.BytesIO(content))) for content in (png, jpeg))
    r = np.hypot(i - 100, j - 100)
    wrong = (mask > 0) != (disc > 0)
    assert 20 < wrong.sum() < 0.5 * 2 * np.pi * 60 and np.abs(r[wrong] - 60).max() < 2.5
    assert mask.astype(bool).sum() == pytest.approx(disc.sum(), rel=0.01)  # neither fat nor thin
    assert picture[r > 75].max() == 0
    assert set(np.unique(mask)) == {0, 255}
    assert np.median(picture[r < 55]) == round(255 * float(encode(np.array(0.5))))


def test_the_ring_looks_at_the_actor_from_all_sides() -> None:
    cameras = ring_cameras(8, 512, np.array([0, 0.9, 0]), rng=np.random.default_rng(0), portrait=4)
    uv, depth = project(cameras, np.array([0, 0.9, 0]))
    assert (depth > 2).all() and np.abs(uv - cameras.size / 2).max() < 12
    feet, head = (project(cameras, np.array([0, y, 0]))[0][:, 1] for y in (0.0, 1.75))
    assert (feet < 512).all() and (head > 0).all() and (feet > head).all()
    assert cameras.size[4].tolist() == [384, 512] and (np.abs(np.linalg.det(cameras.R) - 1) < 1e-12).all()
    turn = np.sort(np.degrees(np.arctan2(*cameras.centres()[:, [0, 2]].T)))
    assert np.diff(turn).max() < 60
    assert (cameras.centres()[:, 1] > 1.6).sum() == 2
