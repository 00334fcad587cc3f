"""Which samples count as seen: layers, tolerances, occluders, sides, image borders."""

import numpy as np
import pytest

from tasks.tracking.settings import Settings
from tasks.tracking.surface import centroids_of_parts, surface
from tasks.tracking.visibility import Occluder, facing_cosines
from tests.tracking.skirt import ring

SETTINGS = Settings()
CAMERAS = ring(2, 256)  # the second looks from behind


def sheets(gap, *, n=12, size=0.4):
    """Two square sheets, the second `gap` [m] behind the first as the first camera sees them:
    vertices and faces, and a unit vector towards that camera.
    """
    towards = CAMERAS.centres()[0] - [0, 0.5, 0]
    towards = towards / np.linalg.norm(towards)
    right = np.cross([0, 1, 0], towards)
    right /= np.linalg.norm(right)
    up = np.cross(towards, right)
    a, b = np.meshgrid(np.linspace(-0.5, 0.5, n) * size, np.linspace(-0.5, 0.5, n) * size)
    front = np.array([0, 0.5, 0]) + a.reshape(-1, 1) * right + b.reshape(-1, 1) * up
    i = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([np.column_stack([i, i + 1, i + n]), np.column_stack([i + 1, i + n + 1, i + n])])
    return np.concatenate([front, front - gap * towards]), np.concatenate([faces, faces + n * n]).astype(np.int32), towards


def seen(gap, *, front="top", behind="top", occluder=None, side=None, facing=0.15):
    """Share of samples of the (front, back) sheet that the first camera sees, and the cosines."""
    x, faces, _ = sheets(gap)
    half = len(faces) // 2
    mesh = surface(x, faces, np.array([front] * half + [behind] * half), SETTINGS)
    cosine = facing_cosines(x, mesh, CAMERAS, occluder=occluder, side=side, facing=facing, settings=SETTINGS)
    front_half, back_half = np.split(cosine[:, 0] != 0, 2)
    return front_half.mean(), back_half.mean(), cosine


def test_what_lies_far_behind_is_hidden():
    front, back, _ = seen(0.1)
    assert front == 1.0 and back < 0.1  # perspective lets no rim show


def test_within_the_tolerance_both_layers_of_a_fold_are_seen():
    edge = 0.4 / 11 * (2 + np.sqrt(2)) / 3
    assert seen(0.6 * SETTINGS.depth_tolerance_edges * edge)[1] > 0.9
    assert seen(1.6 * SETTINGS.depth_tolerance_edges * edge)[1] < 0.1


@pytest.mark.parametrize(
    ("front", "behind", "gap", "visible"), [("body", "skirt", 0.015, True), ("body", "skirt", 0.04, False), ("skirt", "body", 0.003, False)]
)
def test_cloth_wins_over_skin(front, behind, gap, visible):
    assert (seen(gap, front=front, behind=behind)[1] > 0.9) == visible


@pytest.mark.parametrize(("distance", "visible"), [(0.02, True), (0.08, False)])
def test_an_occluder_hides_only_what_is_well_behind_it(distance, visible):
    x, faces, towards = sheets(0.1)
    half = len(faces) // 2
    veil = Occluder(x[: len(x) // 2] * 1.0 + distance * towards, faces[:half])
    assert (seen(0.1, occluder=veil)[0] > 0.9) == visible


def test_the_back_side_has_a_negative_cosine_and_may_be_refused():
    x, faces, _ = sheets(0.1)
    _, _, cosine = seen(0.1)
    outer = np.sign(cosine[cosine[:, 0] != 0, 0])
    inner = np.sign(cosine[cosine[:, 1] != 0, 1])
    assert len(set(outer)) == 1 and set(outer) == {-o for o in set(inner)}
    only = facing_cosines(
        x,
        surface(x, faces, np.full(len(faces), "top"), SETTINGS),
        CAMERAS,
        occluder=None,
        side=np.full(len(cosine), int(outer[0]), np.int8),
        facing=0.15,
        settings=SETTINGS,
    )
    assert (only[:, 0] != 0).any() and not only[:, 1].any()


def test_grazing_views_are_left_out():
    assert seen(0.1, facing=0.999999)[0] < 0.2


def test_samples_outside_the_image_are_not_seen():
    x, faces, _ = sheets(0.1)
    mesh = surface(x, faces, np.full(len(faces), "top"), SETTINGS)
    far = facing_cosines(x + np.array([0, 5.0, 0]), mesh, CAMERAS, occluder=None, side=None, facing=0.15, settings=SETTINGS)
    behind = facing_cosines(
        x + 2 * (CAMERAS.centres()[0] - [0, 0.5, 0]), mesh, CAMERAS.subset([0]), occluder=None, side=None, facing=0.15, settings=SETTINGS
    )
    assert not far.any() and not behind.any()


@pytest.mark.parametrize("k", [1, 2, 3, 4])
def test_samples_are_centroids_of_equal_parts(k):
    b = centroids_of_parts(k)
    assert b.shape == (k * k, 3) and b.sum(1) == pytest.approx(1) and b.min() > 0
    assert b.mean(0) == pytest.approx([1 / 3] * 3)
    if k == 2:
        assert np.sort(b.max(1)) == pytest.approx([1 / 3, 2 / 3, 2 / 3, 2 / 3])
